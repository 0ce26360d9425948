// One PIO state machine: what each instruction does, cycle by cycle (RP2040 data sheet, sections 3.4 and 3.5).
//
// # Design
// `step` plays one cycle. `privateCycles` says for how many cycles to come nothing but the machine's own pc, X
// and Y can change, as long as the inputs and the FIFOs stay as they are; `skip` plays that many at once. The
// block (pio.mjs) uses the two to pass time quickly without a difference in the outcome.
import { FIFO } from '../stock.mjs';

const AUTOPUSH = 1 << 16;
const AUTOPULL = 1 << 17;
const IN_RIGHT = 1 << 18;
const OUT_RIGHT = 1 << 19;
const FJOIN_TX = 1 << 30;
const FJOIN = 0xc0000000;
const SIDE_PINDIR = 1 << 29;
const SIDE_EN = 1 << 30;
const STATUS_RX = 1 << 4;
const EXEC_STALLED = 0x80000000;

/** What a machine waits for before it goes on. */
export const Stall = { none: 0, pin: 1, tx: 2, push: 3, irq: 4 };

/** Longest loop of jumps that is looked for; the memory has 32 instructions. */
const LONGEST_LOOP = 32;

function reverseBits(x) {
  let result = 0;
  for (let bit = 0; bit < 32; bit++) result |= ((x >>> bit) & 1) << (31 - bit);
  return result >>> 0;
}

export class StateMachine {
  constructor(pio, index) {
    this.pio = pio;
    this.index = index;
    this.enabled = false;
    this.x = 0;
    this.y = 0;
    this.pc = 0;
    this.isr = 0;
    this.isrCount = 0;
    this.osr = 0;
    this.osrCount = 32;
    this.delay = 0;
    this.stall = Stall.none;
    /** An instruction that comes before the one at pc, or −1. */
    this.exec = -1;
    this.divider = 256;
    this.dividerPhase = 0;
    this.execCtrl = 0x1f << 12;
    this.shiftCtrl = 0b11 << 18;
    this.pinCtrl = 0x5 << 26;
    this.tx = new FIFO(4);
    this.rx = new FIFO(4);
    this.loops = new Map();
    this.configured();
  }

  /** Takes the fields of the control registers apart. */
  configured() {
    const { execCtrl, shiftCtrl, pinCtrl } = this;
    this.wrapTop = (execCtrl >> 12) & 0x1f;
    this.wrapBottom = (execCtrl >> 7) & 0x1f;
    this.jmpPin = (execCtrl >> 24) & 0x1f;
    this.pushThreshold = (shiftCtrl >> 20) & 0x1f || 32;
    this.pullThreshold = (shiftCtrl >> 25) & 0x1f || 32;
    this.autopull = !!(shiftCtrl & AUTOPULL);
    this.sideCount = (pinCtrl >>> 29) & 0x7;
    this.delayMask = (1 << (5 - this.sideCount)) - 1;
    this.inBase = (pinCtrl >> 15) & 0x1f;
    this.loops.clear();
  }

  restart() {
    this.isr = 0;
    this.isrCount = 0;
    this.osrCount = 32;
    this.delay = 0;
    this.stall = Stall.none;
    this.exec = -1;
  }

  setShiftCtrl(value) {
    const joined = (this.shiftCtrl ^ value) & FJOIN;
    this.shiftCtrl = value;
    if (joined) {
      // Joining gives one FIFO the other's room, and empties both.
      const joinTx = value & FJOIN_TX;
      const joinRx = value >>> 31;
      this.tx = new FIFO(joinRx ? 0 : joinTx ? 8 : 4);
      this.rx = new FIFO(joinTx ? 0 : joinRx ? 8 : 4);
      this.pio.fifoChanged(this);
    }
    this.configured();
  }

  /** Plays `opcode` at once, out of turn. What cannot be finished at once is tried again when enabled. */
  force(opcode) {
    this.stall = Stall.none;
    this.exec = opcode;
    this.run();
  }

  get execCtrlValue() {
    const stalled = this.exec >= 0 && this.stall !== Stall.none;
    return ((this.execCtrl & 0x7fffffff) | (stalled ? EXEC_STALLED : 0)) >>> 0;
  }

  /** One cycle of clk_sys. */
  step() {
    if (this.divider !== 256) {
      this.dividerPhase += 256;
      if (this.dividerPhase < this.divider) return;
      this.dividerPhase -= this.divider;
    }
    if (this.delay > 0) {
      this.delay--;
      this.refill();
      return;
    }
    this.run();
  }

  run() {
    const { exec } = this;
    const opcode = exec >= 0 ? exec : this.pio.instructions[this.pc];
    const before = this.pc;
    this.jumped = false;
    this.execNext = -1;
    this.stall = this.execute(opcode);
    if (opcode >>> 13 !== 0b011) this.refill();
    const field = (opcode >> 8) & 0x1f;
    if (this.sideCount) this.sideSet(field);
    if (this.stall !== Stall.none) return;
    this.exec = this.execNext;
    if (!this.jumped && exec < 0) {
      this.pc = before === this.wrapTop ? this.wrapBottom : (before + 1) & 0x1f;
    }
    // The delay of an instruction that puts another one in its place is not waited for.
    if (this.exec < 0) this.delay = field & this.delayMask;
  }

  sideSet(field) {
    let count = this.sideCount;
    if (this.execCtrl & SIDE_EN) {
      if (!(field & 0x10)) return;
      field &= 0xf;
      count--;
      field >>= 4 - count;
    } else {
      field >>= 5 - count;
    }
    const base = (this.pinCtrl >> 10) & 0x1f;
    if (this.execCtrl & SIDE_PINDIR) this.pio.setDirections(field, base, count);
    else this.pio.setPins(field, base, count);
  }

  /** The background refill of an empty output shift register, in every cycle that is not of an `out`. */
  refill() {
    if (this.autopull && this.osrCount >= this.pullThreshold && !this.tx.empty) this.pull();
  }

  pull() {
    this.osr = this.tx.pull();
    this.osrCount = 0;
    this.pio.fifoChanged(this);
  }

  push() {
    this.rx.push(this.isr);
    this.isr = 0;
    this.isrCount = 0;
    this.pio.fifoChanged(this);
  }

  /** Plays `opcode`; returns what it has to wait for before it is done. */
  execute(opcode) {
    const arg = opcode & 0xff;
    switch (opcode >>> 13) {
      case 0b000:
        if (this.condition(arg >> 5)) this.jump(arg);
        return Stall.none;
      case 0b001:
        return this.wait(arg);
      case 0b010:
        return this.in(arg);
      case 0b011:
        return this.out(arg);
      case 0b100:
        return arg & 0x80 ? this.pullInstruction(arg) : this.pushInstruction(arg);
      case 0b101:
        this.mov(arg);
        return Stall.none;
      case 0b110:
        return this.irqInstruction(arg);
      default:
        this.set(arg);
        return Stall.none;
    }
  }

  jump(target) {
    this.pc = target & 0x1f;
    this.jumped = true;
  }

  condition(condition) {
    switch (condition) {
      case 0b000:
        return true;
      case 0b001:
        return this.x === 0;
      case 0b010: {
        const taken = this.x !== 0;
        this.x = (this.x - 1) >>> 0;
        return taken;
      }
      case 0b011:
        return this.y === 0;
      case 0b100: {
        const taken = this.y !== 0;
        this.y = (this.y - 1) >>> 0;
        return taken;
      }
      case 0b101:
        return this.x !== this.y;
      case 0b110:
        return !!((this.pio.inputs >>> this.jmpPin) & 1);
      default:
        return this.osrCount < this.pullThreshold;
    }
  }

  irqIndex(arg) {
    return arg & 0x10 ? (arg & 0x4) | ((arg + this.index) & 0x3) : arg & 0x7;
  }

  wait(arg) {
    const polarity = arg >> 7;
    const index = arg & 0x1f;
    switch ((arg >> 5) & 0x3) {
      case 0b00:
        return ((this.pio.inputs >>> index) & 1) === polarity ? Stall.none : Stall.pin;
      case 0b01:
        return ((this.pio.inputs >>> ((index + this.inBase) & 0x1f)) & 1) === polarity ? Stall.none : Stall.pin;
      default: {
        const flag = 1 << this.irqIndex(index);
        if (!!(this.pio.irq & flag) !== !!polarity) return Stall.irq;
        if (polarity) this.pio.setIrq(this.pio.irq & ~flag);
        return Stall.none;
      }
    }
  }

  source(source) {
    switch (source) {
      case 0b000: {
        const { inputs } = this.pio;
        return this.inBase ? ((inputs >>> this.inBase) | (inputs << (32 - this.inBase))) >>> 0 : inputs;
      }
      case 0b001:
        return this.x;
      case 0b010:
        return this.y;
      case 0b101: {
        const fifo = this.execCtrl & STATUS_RX ? this.rx : this.tx;
        return fifo.itemCount < (this.execCtrl & 0xf) ? 0xffffffff : 0;
      }
      case 0b110:
        return this.isr;
      case 0b111:
        return this.osr;
      default:
        return 0;
    }
  }

  in(arg) {
    if (this.isrCount < this.pushThreshold || !(this.shiftCtrl & AUTOPUSH)) {
      const bits = arg & 0x1f || 32;
      const value = this.source(arg >> 5);
      if (bits === 32) this.isr = value;
      else if (this.shiftCtrl & IN_RIGHT) this.isr = ((this.isr >>> bits) | (value << (32 - bits))) >>> 0;
      else this.isr = ((this.isr << bits) | (value & ((1 << bits) - 1))) >>> 0;
      this.isrCount = Math.min(32, this.isrCount + bits);
    }
    // Otherwise it was shifted in before and waits for room.
    if (!(this.shiftCtrl & AUTOPUSH) || this.isrCount < this.pushThreshold) return Stall.none;
    if (this.rx.full) {
      this.pio.rxStalled(this);
      return Stall.push;
    }
    this.push();
    return Stall.none;
  }

  out(arg) {
    if (this.autopull && this.osrCount >= this.pullThreshold) {
      // The register is filled in this cycle at best, and the instruction begins in the next.
      if (this.tx.empty) this.pio.txStalled(this);
      else this.pull();
      return Stall.tx;
    }
    const bits = arg & 0x1f || 32;
    let value = this.osr;
    if (bits < 32) {
      if (this.shiftCtrl & OUT_RIGHT) {
        value &= (1 << bits) - 1;
        this.osr >>>= bits;
      } else {
        value >>>= 32 - bits;
        this.osr = (this.osr << bits) >>> 0;
      }
    } else {
      this.osr = 0;
    }
    this.osrCount = Math.min(32, this.osrCount + bits);
    this.outTo(arg >> 5, value >>> 0, bits);
    this.refill();
    return Stall.none;
  }

  outTo(destination, value, bits) {
    switch (destination) {
      case 0b000:
        return this.pio.setPins(value, this.pinCtrl & 0x1f, (this.pinCtrl >> 20) & 0x3f);
      case 0b001:
        this.x = value;
        return;
      case 0b010:
        this.y = value;
        return;
      case 0b100:
        return this.pio.setDirections(value, this.pinCtrl & 0x1f, (this.pinCtrl >> 20) & 0x3f);
      case 0b101:
        return this.jump(value);
      case 0b110:
        this.isr = value;
        this.isrCount = bits;
        return;
      case 0b111:
        this.execNext = value & 0xffff;
    }
  }

  pushInstruction(arg) {
    if (arg & 0x40 && this.isrCount < this.pushThreshold) return Stall.none;
    if (!this.rx.full) {
      this.push();
      return Stall.none;
    }
    this.pio.rxStalled(this);
    if (arg & 0x20) return Stall.push;
    this.isr = 0;
    this.isrCount = 0;
    return Stall.none;
  }

  pullInstruction(arg) {
    if (arg & 0x40 && this.osrCount < this.pullThreshold) return Stall.none;
    // With autopull a `pull` only waits until the register is full.
    if (this.autopull && this.osrCount === 0) return Stall.none;
    if (!this.tx.empty) {
      this.pull();
      return Stall.none;
    }
    if (arg & 0x20) {
      this.pio.txStalled(this);
      return Stall.tx;
    }
    this.osr = this.x;
    this.osrCount = 0;
    return Stall.none;
  }

  mov(arg) {
    let value = this.source(arg & 0x7);
    const operation = (arg >> 3) & 0x3;
    if (operation === 0b01) value = ~value >>> 0;
    else if (operation === 0b10) value = reverseBits(value);
    const destination = arg >> 5;
    switch (destination) {
      case 0b100:
        this.execNext = value & 0xffff;
        break;
      case 0b110:
        this.isr = value;
        this.isrCount = 0;
        break;
      case 0b111:
        this.osr = value;
        this.osrCount = 0;
        break;
      case 0b011:
        break;
      default:
        this.outTo(destination, value, 32);
    }
  }

  irqInstruction(arg) {
    const flag = 1 << this.irqIndex(arg & 0x1f);
    if (arg & 0x40) {
      this.pio.setIrq(this.pio.irq & ~flag);
      return Stall.none;
    }
    if (this.stall === Stall.irq) return this.pio.irq & flag ? Stall.irq : Stall.none;
    this.pio.setIrq(this.pio.irq | flag);
    return arg & 0x20 ? Stall.irq : Stall.none;
  }

  set(arg) {
    const value = arg & 0x1f;
    const base = (this.pinCtrl >> 5) & 0x1f;
    const count = (this.pinCtrl >> 26) & 0x7;
    switch (arg >> 5) {
      case 0b000:
        return this.pio.setPins(value, base, count);
      case 0b001:
        this.x = value;
        return;
      case 0b010:
        this.y = value;
        return;
      case 0b100:
        return this.pio.setDirections(value, base, count);
    }
  }

  /** For how many cycles from now nothing can change but pc, X, Y and the delay. */
  privateCycles() {
    if (this.divider !== 256) return 0;
    if (this.autopull && this.osrCount >= this.pullThreshold && !this.tx.empty) return 0;
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
