// Peripherals of which only registers are needed: the ring oscillator with its random bit, the core's voltage,
// and RESETS, which brings other peripherals to their reset state.
//
// Stock reads all ones from the first two, so that a random number is the same at every boot, and its RESETS
// resets nothing.
import { BasePeripheral } from '../stock.mjs';

/** Registers that keep what is written to them. */
export class Registers extends BasePeripheral {
  /** `initial` maps offsets to values after a reset. */
  constructor(rp2040, name, initial) {
    super(rp2040, name);
    this.values = new Map(Object.entries(initial).map(([offset, value]) => [Number(offset), value]));
  }

  readUint32(offset) {
    return this.values.has(offset) ? this.values.get(offset) >>> 0 : super.readUint32(offset);
  }

  writeUint32(offset, value) {
    if (this.values.has(offset)) this.values.set(offset, value >>> 0);
    else super.writeUint32(offset, value);
  }
}

const ROSC_STATUS = 0x18;
const ROSC_RANDOMBIT = 0x1c;

/** The ring oscillator, which is always stable here. */
export class Rosc extends Registers {
  /** `random` gives numbers in [0, 1). */
  constructor(rp2040, name, random) {
    // CTRL, FREQA, FREQB, DORMANT, DIV, PHASE, COUNT
    super(rp2040, name, { 0x00: 0xaa0, 0x04: 0, 0x08: 0, 0x0c: 0x77616b65, 0x10: 0xaa0, 0x14: 8, 0x20: 0 });
    this.random = random;
  }

  readUint32(offset) {
    if (offset === ROSC_STATUS) return 0x80001000;
    if (offset === ROSC_RANDOMBIT) return this.random() < 0.5 ? 0 : 1;
    return super.readUint32(offset);
  }
}

/** Voltage regulator (in regulation), brown-out detector, and why the chip was reset: at power-up. */
export const VREG_AND_CHIP_RESET = { 0x00: 0x10b1, 0x04: 0x91, 0x08: 0x100 };

/** Flash cache: on, ready, counters, and no stream. */
export const XIP = { 0x00: 3, 0x04: 0, 0x08: 2, 0x0c: 0, 0x10: 0, 0x14: 0, 0x18: 0 };

const RESET = 0x0;
const WDSEL = 0x4;
const RESET_DONE = 0x8;
const ALL = 0x1ffffff;

/** RESETS: a bit that is set holds a peripheral in its reset state. */
export class Resets extends BasePeripheral {
  /** `reset` maps bits to what brings their peripherals to the reset state. */
  constructor(rp2040, name, reset) {
    super(rp2040, name);
    this.reset = reset;
    this.held = 0;
    this.wdsel = 0;
  }

  readUint32(offset) {
    if (offset === RESET) return this.held;
    if (offset === WDSEL) return this.wdsel;
    if (offset === RESET_DONE) return ALL & ~this.held;
    return super.readUint32(offset);
  }

  writeUint32(offset, value) {
    if (offset === WDSEL) this.wdsel = value & ALL;
    if (offset !== RESET) return;
    const begun = value & ~this.held;
    this.held = value & ALL;
    for (const [bit, reset] of Object.entries(this.reset)) if (begun & (1 << bit)) reset();
  }
}
