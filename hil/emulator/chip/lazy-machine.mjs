// A state machine that need not be stepped while it only counts or waits.
//
// # Design
// After a cycle was played, `privateCycles` says for how many cycles to come nothing but the machine's own pc, X,
// Y and delay can change, as long as the inputs and the FIFOs stay as they are; `skip` plays that many at once.
// Programs spend nearly all of their time stalled or in short loops of jumps that count X or Y down, whatever
// else they do, so loops are found in the instructions as they are, and remembered.
//
// # Tradeoffs
// A machine with a clock divider is never passed over, nor is a loop with side-set.
import { Stall, StateMachine } from './state-machine.mjs';

/** Longest loop of jumps that is looked for; the memory has 32 instructions. */
const LONGEST_LOOP = 32;

export class LazyMachine extends StateMachine {
  configured() {
    super.configured();
    this.forgetLoops();
  }

  /** To be called when instructions have changed. */
  forgetLoops() {
    /** By pc and the level of the pin that `jmp pin` tests. */
    this.loops = new Map();
  }

  /** For how many cycles from now nothing can change but pc, X, Y and the delay. */
  privateCycles() {
    if (this.divider !== 256) return 0;
    if (this.delay > 0) return this.delay;
    switch (this.stall) {
      case Stall.none:
        break;
      case Stall.pin: {
        const opcode = this.exec >= 0 ? this.exec : this.pio.instructions[this.pc];
        return this.wait(opcode & 0xff) === Stall.pin ? Infinity : 0;
      }
      case Stall.tx:
        // An `out` whose register was filled in the last cycle goes on now.
        return this.tx.empty && !(this.autopull && this.osrCount < this.pullThreshold) ? Infinity : 0;
      case Stall.push:
        return this.rx.full ? Infinity : 0;
      default:
        return 0;
    }
    if (this.exec >= 0) return 0;
    const loop = this.loop();
    return loop ? loop.cycles * this.passes(loop) : 0;
  }

  /** Plays `cycles` cycles, no more than `privateCycles` said. */
  skip(cycles) {
    if (this.stall !== Stall.none) return;
    if (this.delay > 0) {
      this.delay -= cycles;
      return;
    }
    const loop = this.loop();
    const passes = Math.floor(cycles / loop.cycles);
    this.x = (this.x - passes * loop.x) >>> 0;
    this.y = (this.y - passes * loop.y) >>> 0;
    for (let rest = cycles - passes * loop.cycles; rest > 0; rest--) this.step();
  }

  /** Passes of `loop` in which no counter is found at zero. */
  passes(loop) {
    return Math.min(
      loop.x ? Math.floor(this.x / loop.x) : Infinity,
      loop.y ? Math.floor(this.y / loop.y) : Infinity,
    );
  }

  /** The loop of jumps that the machine is in while the inputs stay, or null. */
  loop() {
    const level = (this.pio.inputs >>> this.jmpPin) & 1;
    const key = (this.pc << 1) | level;
    let loop = this.loops.get(key);
    if (loop === undefined) {
      loop = this.findLoop(level);
      this.loops.set(key, loop);
    }
    return loop;
  }

  findLoop(level) {
    if (this.sideCount) return null;
    const loop = { cycles: 0, x: 0, y: 0 };
    let { pc } = this;
    for (let length = 0; length < LONGEST_LOOP; length++) {
      const opcode = this.pio.instructions[pc];
      if (opcode >>> 13 !== 0) return null;
      loop.cycles += 1 + ((opcode >> 8) & 0x1f);
      const condition = (opcode >> 5) & 0x7;
      let taken = true;
      if (condition === 0b010) loop.x++;
      else if (condition === 0b100) loop.y++;
      else if (condition === 0b110) taken = level === 1;
      else if (condition !== 0b000) return null;
      if (taken) pc = opcode & 0x1f;
      else pc = pc === this.wrapTop ? this.wrapBottom : (pc + 1) & 0x1f;
      if (pc === this.pc) return loop;
    }
    return null;
  }
}
