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
