// Two chips to observe: the stock one, and a machine with all mends. A test of a mend looks at both.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Machine } from '../machine.mjs';
import { RP2040, SimulationClock } from '../stock.mjs';

export const RAM = 0x20000000;
export const HZ = 125e6;
const VECTORS = 0x10000100;
const START = 0x10000200;
const STACK = 0x20008000;
/** `wfi` for ever. */
const SLEEP = [0xbf30, 0xe7fd];

/** An image of Thumb instructions. */
export function imageOf(code) {
  const bytes = Buffer.alloc(START - VECTORS + 2 * code.length);
  bytes.writeUInt32LE(STACK, 0);
  bytes.writeUInt32LE(START | 1, 4);
  code.forEach((opcode, index) => bytes.writeUInt16LE(opcode, START - VECTORS + 2 * index));
  return { segments: [{ address: VECTORS, bytes }], symbols: [] };
}

/** A machine whose CPU sleeps, at 125 MHz. */
export function sleepingMachine(options) {
  const machine = new Machine(imageOf(SLEEP), options);
  const { mcu, clock } = machine.chip;
  mcu.clkSys = HZ;
  mcu.clkPeri = HZ;
  clock.setRate(HZ);
  machine.run(10);
  return machine;
}

export function stockRig() {
  const mcu = new RP2040(new SimulationClock());
  mcu.logger = { debug() {}, info() {}, warn() {}, error() {} };
  // Without it the stock alarm goes off for ever in the instant of the bite.
  const watchdog = mcu.peripherals[0x40058];
  watchdog.onWatchdogTrigger = () => (watchdog.alarm.enable = false);
  return {
    mcu,
    /** Time passes; what in stock is bound to no clock is given one step per cycle. */
    pass(cycles) {
      for (let i = 0; i < cycles; i++) {
        mcu.clock.tick(1e9 / HZ);
        for (const pio of mcu.pio) if (!pio.stopped) pio.step();
      }
    },
    receive: (byte) => mcu.uart[0].feedByte(byte),
    end: () => mcu.pio.forEach((pio) => pio.stop()),
  };
}

export function mendedRig() {
  const machine = sleepingMachine();
  return {
    get mcu() {
      return machine.chip.mcu;
    },
    pass: (cycles) => machine.run(cycles),
    receive: (byte) => machine.chip.uart.receive(byte),
    end() {},
  };
}

/** Puts `code` into RAM and executes `steps` instructions from there; `before(core)` sets the core up. */
export function execute({ mcu }, code, steps, before = () => {}) {
  const { core } = mcu;
  code.forEach((opcode, index) => mcu.writeUint16(RAM + 2 * index, opcode));
  core.registers[13] = STACK;
  core.PC = RAM;
  core.waiting = false;
  before(core);
  let cycles = 0;
  for (let i = 0; i < steps && !core.waiting; i++) cycles += core.executeInstruction();
  return { core, cycles };
}

/** A mend: `observe(rig)` sees `stock` on the stock chip, which is wrong, and `right` on the mended one. */
export function mend(name, observe, { stock, right }) {
  test(name, () => {
    assert.notDeepEqual(stock, right);
    for (const [rig, expected] of [
      [stockRig(), stock],
      [mendedRig(), right],
    ]) {
      try {
        assert.deepEqual(observe(rig), expected, expected === stock ? 'the stock chip' : 'the mended chip');
      } finally {
        rig.end();
      }
    }
  });
}
