// The wires at the chip's pins: who drives them, which level they have, and when it changed.
//
// # Design
// A wire has the level of the chip's output if it drives one, else of what drives it from outside, else of the
// pad's pull, else the one that it had. The chip's inputs see the wire. Wires outlive a reset, which makes the
// pads let go of them.
//
// Stock knows neither pulls nor that an input sees what the same pin puts out, and begins with the inputs of all
// pads switched off.
import { GPIOPin } from 'rp2040js';

const PAD_RESET = 0x56;

export class Pad extends GPIOPin {
  constructor(rp2040, index, wires) {
    super(rp2040, index);
    this.padValue = PAD_RESET;
    this.wires = wires;
  }

  resetControl() {
    this.ctrl = 0x1f;
    this.irqEnableMask = 0;
    this.irqForceMask = 0;
    this.checkForUpdates();
  }

  resetPad() {
    this.padValue = PAD_RESET;
    this.checkForUpdates();
  }

  /** Called by whatever changes this pin's output, function, overrides or pad control. */
  checkForUpdates() {
    this.wires?.update(this.index);
  }
}

export class Wires {
  /** `watched` are the pins whose edges are told: `onEdge(pin, level)`. */
  constructor(count, watched, onEdge) {
    this.levels = new Uint8Array(count);
    /** What drives a wire from outside: 0, 1, or −1 for nothing. */
    this.outside = new Int8Array(count).fill(-1);
    this.watched = watched;
    this.onEdge = onEdge;
    this.chip = null;
    /** Lets the PIO see its inputs later, as the input synchroniser does; at once without. */
    this.later = (action) => action();
  }

  /** Puts `chip` on the wires. */
  connect(chip) {
    this.chip = chip;
    for (const pin of this.levels.keys()) {
      this.update(pin);
      chip.gpio[pin].rawInputValue = this.levels[pin] === 1;
    }
    this.updateInputs();
  }

  drive(pin, level) {
    this.outside[pin] = level;
    this.update(pin);
  }

  isDriven(pin) {
    const { outputEnable, outputDisable } = this.chip.gpio[pin];
    return outputEnable && !outputDisable;
  }

  update(pin) {
    const level = this.levelOf(pin);
    if (level !== this.levels[pin]) {
      this.levels[pin] = level;
      this.chip.gpio[pin].setInputValue(level === 1);
      if (this.watched.has(pin)) this.onEdge(pin, level);
    }
    this.updateInputs();
  }

  levelOf(pin) {
    const pad = this.chip.gpio[pin];
    if (this.isDriven(pin)) return pad.outputValue ? 1 : 0;
    if (this.outside[pin] >= 0) return this.outside[pin];
    if (pad.pullupEnabled !== pad.pulldownEnabled) return pad.pullupEnabled ? 1 : 0;
    return this.levels[pin];
  }

  updateInputs() {
    const { chip } = this;
    const inputs = chip.gpioValues >>> 0;
    this.later(() => {
      for (const pio of chip.pio) pio.setInputs(inputs);
    });
  }
}
