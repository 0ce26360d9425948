import assert from 'node:assert/strict';
import { test } from 'node:test';
import { mend, sleepingMachine } from '../rig/rigs.mjs';

const PIO = 0x50200000;
const CTRL = PIO + 0x00;
const FLEVEL = PIO + 0x0c;
const TXF0 = PIO + 0x10;
const INSTR_MEM0 = PIO + 0x48;
const SHIFTCTRL = PIO + 0xd0;
const INSTR = PIO + 0xd8;
const PINCTRL = PIO + 0xdc;
const EXECCTRL = PIO + 0xcc;
const AUTOPULL = 1 << 17;
const SHIFT_RIGHT = 3 << 18;
const FJOIN_TX = 1 << 30;

const MOV_X_NOT_NULL = 0xa02b;
const JMP_X_DEC_0 = 0x0040;
const JMP_0 = 0x0000;
const OUT_X_32 = 0x6020;
const OUT_PINS_2 = 0x6002;
const OUT_X_30 = 0x603e;
const SET_PINDIRS_3 = 0xe083;

function load(mcu, program) {
  program.forEach((opcode, index) => mcu.writeUint32(INSTR_MEM0 + 4 * index, opcode));
  mcu.writeUint32(EXECCTRL, (program.length - 1) << 12);
}

mend(
  'an instruction takes a cycle of clk_sys, and none is taken while no time passes',
  ({ mcu, pass }) => {
    load(mcu, [JMP_X_DEC_0]);
    mcu.writeUint32(INSTR, MOV_X_NOT_NULL);
    mcu.writeUint32(CTRL, 1);
    const counted = () => {
      mcu.readUint32(CTRL);
      return 0xffffffff - mcu.pio[0].machines[0].x;
    };
    const atOnce = counted();
    pass(100);
    return [atOnce, counted()];
  },
  { stock: [1000, 1100], right: [0, 100] },
);

mend(
  'FJOIN makes one FIFO of eight words',
  ({ mcu }) => {
    mcu.writeUint32(SHIFTCTRL, FJOIN_TX | SHIFT_RIGHT);
    for (let word = 0; word < 9; word++) mcu.writeUint32(TXF0, word);
    return mcu.readUint32(FLEVEL) & 0xf;
  },
  { stock: 4, right: 8 },
);

mend(
  'an empty output shift register is refilled in the background',
  ({ mcu, pass }) => {
    load(mcu, [JMP_0]);
    mcu.writeUint32(SHIFTCTRL, AUTOPULL | SHIFT_RIGHT);
    mcu.writeUint32(CTRL, 1 | (1 << 4));
    mcu.writeUint32(TXF0, 1);
    mcu.writeUint32(TXF0, 2);
    pass(2);
    return mcu.readUint32(FLEVEL) & 0xf;
  },
  { stock: 2, right: 1 },
);

mend(
  'a stalled instruction goes on with the clock, not with the write to its FIFO',
  ({ mcu, pass }) => {
    load(mcu, [OUT_X_32]);
    mcu.writeUint32(SHIFTCTRL, AUTOPULL | SHIFT_RIGHT);
    mcu.writeUint32(CTRL, 1 | (1 << 4));
    pass(5);
    const seen = [];
    mcu.writeUint32(TXF0, 7);
    for (let cycle = 0; cycle < 3; cycle++) {
      mcu.readUint32(CTRL);
      seen.push(mcu.pio[0].machines[0].x);
      pass(1);
    }
    return seen;
  },
  // One cycle fills the register, the next one is the `out`.
  { stock: [7, 7, 7], right: [0, 0, 7] },
);

/** The edges that words make, from a free-running program. */
function play(words, { lazy }) {
  const machine = sleepingMachine({ lazy });
  const { mcu } = machine.chip;
  machine.edges.length = 0;
  load(mcu, [OUT_PINS_2, OUT_X_30, 0x0042]);
  mcu.writeUint32(PINCTRL, (2 << 20) | (2 << 26) | (2 << 5) | 2);
  mcu.writeUint32(SHIFTCTRL, (AUTOPULL | SHIFT_RIGHT | FJOIN_TX) >>> 0);
  mcu.writeUint32(INSTR, SET_PINDIRS_3);
  for (const pin of [2, 3]) mcu.writeUint32(0x40014000 + 8 * pin + 4, 6);
  for (const word of words) mcu.writeUint32(TXF0, word);
  mcu.writeUint32(CTRL, 1 | (1 << 4));
  machine.run(100_000);
  return machine.edges;
}

test('a word of count n lasts n + 3 cycles', () => {
  const counts = [0, 1, 5, 1000, 0, 0, 70_000, 0];
  const words = counts.map((count, index) => count * 4 + ((index & 1) ^ 1));
  const edges = play(words, { lazy: true });
  const at = edges.filter((_, index) => index % 3 === 0);
  assert.equal(at.length, counts.length);
  for (let i = 1; i < at.length; i++) assert.equal(at[i] - at[i - 1], counts[i - 1] + 3, `word ${i - 1}`);
});

test('cycles that are passed over make no difference', () => {
  const words = [3, 400, 2 * 4 + 1, 4000 * 4 + 2, 1, 0, 8 + 3, 12].map(Number);
  assert.deepEqual(play(words, { lazy: true }), play(words, { lazy: false }));
});

/** What machine 0 has become after `cycles` of `program`. */
function after(program, cycles, { words = [], shift = SHIFT_RIGHT, pins = 0, side = 0 } = {}) {
  const machine = sleepingMachine();
  const { mcu } = machine.chip;
  load(mcu, program);
  mcu.writeUint32(SHIFTCTRL, shift);
  mcu.writeUint32(PINCTRL, ((side << 29) | pins) >>> 0);
  for (const word of words) mcu.writeUint32(TXF0, word);
  mcu.writeUint32(CTRL, 1 | (1 << 4));
  machine.run(cycles);
  mcu.readUint32(CTRL);
  const [pio] = mcu.pio;
  return { ...pio.machines[0], pins: pio.pinValues, irq: pio.irq };
}

test('instructions that the firmware does not use', () => {
  const outPins = (32 << 20) | 0;
  const setPins = (5 << 26) | (30 << 5);
  for (const [name, found, expected] of [
    ['set y, 5 [3]', after([0xe345, 0xe047], 4), { y: 5, pc: 1 }],
    ['its delay is over', after([0xe345, 0xe047], 5), { y: 7 }],
    ['pull; mov exec, osr (set x, 9)', after([0x80a0, 0xa087, 0x0002], 3, { words: [0xe029] }), { x: 9, pc: 2 }],
    ['pull; out exec, 16 (set x, 9)', after([0x80a0, 0x60f0, 0x0002], 3, { words: [0xe029] }), { x: 9, pc: 2 }],
    ['pull noblock takes X', after([0xe023, 0x8080, 0x0002], 2), { osr: 3, osrCount: 0 }],
    ['mov y, ::x', after([0xe021, 0xa051, 0x0002], 2), { y: 0x80000000 }],
    ['in x, 4 to the right', after([0xe02b, 0x4024, 0x0002], 2), { isr: 0xb0000000, isrCount: 4 }],
    ['in x, 4 to the left', after([0xe02b, 0x4024, 0x0002], 2, { shift: 0 }), { isr: 0xb, isrCount: 4 }],
    ['set pins around the end', after([0xe007, 0x0001], 1, { pins: setPins }), { pins: 1 }],
    ['mov pins, ~null', after([0xa00b, 0x0001], 1, { pins: outPins }), { pins: 0x3fffffff }],
    ['nop side 1', after([0xb042, 0x0001], 1, { side: 1 }), { pins: 1 }],
    ['irq wait 1', after([0xc021, 0xe025], 5), { irq: 2, pc: 0, x: 0 }],
    ['irq 1; wait 1 irq 1', after([0xc001, 0x20c1, 0x0002], 2), { irq: 0, pc: 2 }],
    ['jmp y-- from 0 falls through and wraps', after([0x0080, 0x0001], 1), { y: 0xffffffff, pc: 1 }],
    ['jmp x != y', after([0xe021, 0x00a3, 0xe047, 0x0003], 3), { y: 0, pc: 3 }],
    ['jmp !osre', after([0x00e2, 0xe025, 0x0002], 2), { x: 5 }],
  ]) {
    for (const [field, value] of Object.entries(expected)) assert.equal(found[field], value, `${name}: ${field}`);
  }
});

test('a clock divider makes instructions last as long', () => {
  const machine = sleepingMachine();
  const { mcu } = machine.chip;
  load(mcu, [JMP_X_DEC_0]);
  mcu.writeUint32(PIO + 0xc8, (2 << 16) | (0x80 << 8));
  mcu.writeUint32(INSTR, MOV_X_NOT_NULL);
  mcu.writeUint32(CTRL, 1);
  machine.run(1000);
  assert.equal(0xffffffff - mcu.pio[0].machines[0].x, 400);
});
