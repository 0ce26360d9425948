// What is at the other end of the input lines: a camera that answers with STROBE, a projector that gives vsync.
//
// # Design
// Both are events of the world. The strobe reacts to the edges of CAM, the vsync runs by itself and keeps only
// its next pulse in the world's list. Equal requests make equal edges: the jitter is drawn from a seed.

import { randomFrom } from '../random.mjs';

/** A line that is driven by events which can be taken back. */
class Driver {
  constructor(machine, pin) {
    this.machine = machine;
    this.pin = pin;
    this.events = new Set();
    machine.wires.drive(pin, 0);
  }

  at(cycle, level, then) {
    const event = this.machine.world.at(cycle, () => {
      this.events.delete(event);
      this.machine.wires.drive(this.pin, level);
      then?.();
    });
    this.events.add(event);
  }

  stop() {
    for (const event of this.events) this.machine.world.cancel(event);
    this.machine.wires.drive(this.pin, 0);
  }
}

/** STROBE follows CAM. */
export class Strobe extends Driver {
  /** Times in cycles; `width` 0 stands for the width of the CAM pulse. */
  constructor(machine, pin, { delay, width, ignore = [], extra = [] }) {
    super(machine, pin);
    this.delay = Math.max(delay, 1);
    this.width = width;
    this.ignore = new Set(ignore);
    this.triggers = 0;
    this.following = false;
    for (const cycle of extra) {
      this.at(cycle, 1);
      this.at(cycle + Math.max(width, 1), 0);
    }
  }

  /** CAM has changed at `cycle`. */
  camEdge(cycle, level) {
    if (level === 1) {
      this.following = !this.ignore.has(this.triggers++);
      if (!this.following) return;
      this.at(cycle + this.delay, 1);
      if (this.width > 0) this.at(cycle + this.delay + this.width, 0);
    } else if (this.following && this.width === 0) {
      this.at(cycle + this.delay, 0);
    }
  }
}

/** A train of pulses. */
export class Vsync extends Driver {
  /** Times in cycles: pulse k rises at first + k·period, give or take up to `jitter`. */
  constructor(machine, pin, { first, period, width, jitter = 0, seed = 0, missing = [], double = [] }) {
    super(machine, pin);
    this.timing = { first, period, width, jitter };
    this.random = randomFrom(seed);
    this.missing = new Set(missing);
    this.double = new Set(double);
    this.index = 0;
    this.schedule();
  }

  /** Puts the next pulse that is still to come into the world. */
  schedule() {
    const { first, period, width, jitter } = this.timing;
    for (;;) {
      const index = this.index++;
      const offset = Math.floor(this.random() * (2 * jitter + 1)) - jitter;
      const rise = first + index * period + offset;
      if (rise < this.machine.stamp || this.missing.has(index)) continue;
      this.at(rise, 1, () => this.schedule());
      this.at(rise + width, 0);
      if (this.double.has(index)) {
        const second = rise + Math.floor(period / 4);
        this.at(second, 1);
        this.at(second + width, 0);
      }
      return;
    }
  }
}
