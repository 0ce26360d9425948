// A PIO block in step with clk_sys.
//
// # Design
// `tick` plays one cycle of all machines. Between two ticks that matter the block is behind the CPU: `quiet` is
// the last cycle until which every machine keeps to itself (StateMachine.privateCycles), and `catchUp` plays
// what is missing when somebody looks or interferes. Whoever changes what the machines see (registers, FIFOs,
// inputs) calls `touch` first, after which every cycle counts again until the next tick has looked.
//
// The stock PIO runs on a timer of the host computer, thousands of instructions at a time, unrelated to the
// cycles of the CPU; ignores FJOIN; refills the output shift register too late; and makes the wait of one
// instruction end in the middle of a register access.
import { BasePeripheral } from '../stock.mjs';
import { StateMachine } from './state-machine.mjs';

const CTRL = 0x000;
const FSTAT = 0x004;
const FDEBUG = 0x008;
const FLEVEL = 0x00c;
const TXF0 = 0x010;
const RXF0 = 0x020;
const IRQ = 0x030;
const IRQ_FORCE = 0x034;
const INPUT_SYNC_BYPASS = 0x038;
const DBG_PADOUT = 0x03c;
const DBG_PADOE = 0x040;
const DBG_CFGINFO = 0x044;
const INSTR_MEM0 = 0x048;
const SM0_CLKDIV = 0x0c8;
const SM_STRIDE = 0x18;
const INTR = 0x128;
const IRQ0_INTE = 0x12c;
const IRQ1_INTS = 0x140;
// Of one state machine, from its CLKDIV.
const CLKDIV = 0x00;
const EXECCTRL = 0x04;
const SHIFTCTRL = 0x08;
const ADDR = 0x0c;
const INSTR = 0x10;
const PINCTRL = 0x14;

const PINS = 0x3fffffff;
const TXSTALL = 1 << 24;
const TXOVER = 1 << 16;
const RXUNDER = 1 << 8;
const RXSTALL = 1 << 0;

export class Pio extends BasePeripheral {
  /**
   * `time` tells the cycle until which the block shall have run (`ticked`), and is told of the cycle that
   * counts next (`expect`) and of pins that have changed (`outputsChanged`). `lazy: false` makes every cycle count.
   */
  constructor(rp2040, name, firstIrq, index, time, { lazy = true } = {}) {
    super(rp2040, name);
    this.firstIrq = firstIrq;
    this.firstDreq = index * 8;
    this.time = time;
    this.lazy = lazy;
    /** Levels of all inputs as the machines see them. */
    this.inputs = 0;
    this.reported = { values: 0, directions: 0 };
    this.reset();
  }

  /** Everything as it is after a reset. */
  reset() {
    this.instructions = new Uint32Array(32);
    this.pinValues = 0;
    this.pinDirections = 0;
    this.irq = 0;
    this.fdebug = 0;
    this.inputSyncBypass = 0;
    // INTE and INTF of both interrupts.
    this.interrupts = [0, 0, 0, 0];
    this.machines = [0, 1, 2, 3].map((i) => new StateMachine(this, i));
    this.running = [];
    /** The cycle until which it has run. */
    this.at = this.time.ticked;
    /** The cycle until which nothing happens that matters to others. */
    this.quiet = Infinity;
    for (const machine of this.machines) this.fifoChanged(machine);
    this.signalled = true;
    this.updateInterrupts();
    this.reportPins();
  }

  /** One cycle, the one after `at`. What it did to the pins is told by `reportPins`. */
  tick() {
    this.at++;
    for (const machine of this.running) machine.step();
    this.plan();
  }

  /** Finds out until when the machines keep to themselves. */
  plan() {
    let cycles = this.lazy || this.running.length === 0 ? Infinity : 0;
    for (const machine of this.running) {
      if (cycles === 0) break;
      cycles = Math.min(cycles, machine.privateCycles());
    }
    this.quiet = this.at + cycles;
  }

  /** Plays the cycles that are missing; none of them matters to others. */
  catchUp() {
    const cycles = this.time.ticked - this.at;
    if (cycles <= 0) return;
    for (const machine of this.running) machine.skip(cycles);
    this.at += cycles;
  }

  /** To be called before anything changes that the machines depend on. */
  touch() {
    this.catchUp();
    this.at = this.time.ticked;
    this.quiet = this.running.length ? this.at : Infinity;
    this.time.expect(this.quiet + 1);
  }

  setInputs(inputs) {
    if (inputs === this.inputs) return;
    this.touch();
    this.inputs = inputs;
  }

  setPins(value, base, count) {
    this.pinValues = merge(this.pinValues, value, base, count);
  }

  setDirections(value, base, count) {
    this.pinDirections = merge(this.pinDirections, value, base, count);
  }

  /** Tells of the pins that have changed since the last report. */
  reportPins() {
    const changed = (this.reported.values ^ this.pinValues) | (this.reported.directions ^ this.pinDirections);
    if (!changed) return;
    this.reported = { values: this.pinValues, directions: this.pinDirections };
    this.time.outputsChanged(changed);
  }

  setIrq(flags) {
    this.irq = flags & 0xff;
    this.updateInterrupts();
  }

  txStalled(machine) {
    this.fdebug |= TXSTALL << machine.index;
  }

  rxStalled(machine) {
    this.fdebug |= RXSTALL << machine.index;
  }

  /** Tells the DMA and the interrupt controller of a FIFO's level. */
  fifoChanged({ index, tx, rx }) {
    const { dma } = this.rp2040;
    if (tx.full) dma.clearDREQ(this.firstDreq + index);
    else dma.setDREQ(this.firstDreq + index);
    if (rx.empty) dma.clearDREQ(this.firstDreq + 4 + index);
    else dma.setDREQ(this.firstDreq + 4 + index);
    this.updateInterrupts();
  }

  get intRaw() {
    let raw = (this.irq & 0xf) << 8;
    for (const { index, tx, rx } of this.machines) {
      if (!tx.full) raw |= 0x10 << index;
      if (!rx.empty) raw |= 0x01 << index;
    }
    return raw;
  }

  interruptStatus(number) {
    return (this.intRaw & this.interrupts[2 * number]) | this.interrupts[2 * number + 1];
  }

  updateInterrupts() {
    const { interrupts } = this;
    if (!this.signalled && !(interrupts[0] | interrupts[1] | interrupts[2] | interrupts[3])) return;
    this.signalled = false;
    for (const number of [0, 1]) {
      const set = this.interruptStatus(number) !== 0;
      this.signalled ||= set;
      this.rp2040.setInterrupt(this.firstIrq + number, set);
    }
  }

  readUint32(offset) {
    this.catchUp();
    if (offset >= SM0_CLKDIV && offset < INTR) return this.readMachine(offset - SM0_CLKDIV);
    if (offset >= RXF0 && offset < IRQ) return this.readFifo(this.machines[(offset - RXF0) >> 2]);
    if (offset >= IRQ0_INTE && offset <= IRQ1_INTS) {
      const number = offset >= IRQ0_INTE + 12 ? 1 : 0;
      const register = (offset - IRQ0_INTE) / 4 - 3 * number;
      return register === 2 ? this.interruptStatus(number) : this.interrupts[2 * number + register];
    }
    switch (offset) {
      case CTRL:
        return this.machines.reduce((bits, machine) => bits | (machine.enabled ? 1 << machine.index : 0), 0);
      case FSTAT:
        return this.machines.reduce((bits, machine) => bits | (fifoStatus(machine) << machine.index), 0);
      case FDEBUG:
        return this.fdebug;
      case FLEVEL:
        return this.machines.reduce(
          (bits, { index, tx, rx }) => (bits | (tx.itemCount << (8 * index)) | (rx.itemCount << (8 * index + 4))) >>> 0,
          0,
        );
      case IRQ:
        return this.irq;
      case IRQ_FORCE:
        return 0;
      case INPUT_SYNC_BYPASS:
        return this.inputSyncBypass;
      case DBG_PADOUT:
        return this.pinValues;
      case DBG_PADOE:
        return this.pinDirections;
      case DBG_CFGINFO:
        return 0x200404;
      case INTR:
        return this.intRaw;
    }
    return super.readUint32(offset);
  }

  readMachine(offset) {
    const machine = this.machines[Math.floor(offset / SM_STRIDE)];
    switch (offset % SM_STRIDE) {
      case CLKDIV:
        return ((machine.divider & 0xffffff) << 8) >>> 0;
      case EXECCTRL:
        return machine.execCtrlValue;
      case SHIFTCTRL:
        return machine.shiftCtrl;
      case ADDR:
        return machine.pc;
      case INSTR:
        return machine.exec >= 0 ? machine.exec : this.instructions[machine.pc];
      default:
        return machine.pinCtrl;
    }
  }

  readFifo(machine) {
    if (machine.rx.empty) {
      this.fdebug |= RXUNDER << machine.index;
      return 0;
    }
    this.touch();
    const word = machine.rx.pull();
    this.fifoChanged(machine);
    return word;
  }

  writeUint32(offset, value) {
    this.touch();
    if (offset >= INSTR_MEM0 && offset < SM0_CLKDIV) {
      this.instructions[(offset - INSTR_MEM0) >> 2] = value & 0xffff;
      for (const machine of this.machines) machine.loops.clear();
      return;
    }
    if (offset >= SM0_CLKDIV && offset < INTR) {
      this.writeMachine(offset - SM0_CLKDIV, value >>> 0);
      return;
    }
    if (offset >= TXF0 && offset < RXF0) {
      this.writeFifo(this.machines[(offset - TXF0) >> 2], value);
      return;
    }
    if (offset >= IRQ0_INTE && offset <= IRQ1_INTS) {
      const number = offset >= IRQ0_INTE + 12 ? 1 : 0;
      const register = (offset - IRQ0_INTE) / 4 - 3 * number;
      if (register < 2) this.interrupts[2 * number + register] = value & 0xfff;
      this.updateInterrupts();
      return;
    }
    switch (offset) {
      case CTRL:
        this.control(value);
        break;
      case FDEBUG:
        this.fdebug &= ~this.rawWriteValue;
        break;
      case IRQ:
        this.setIrq(this.irq & ~this.rawWriteValue);
        break;
      case IRQ_FORCE:
        this.setIrq(this.irq | value);
        break;
      case INPUT_SYNC_BYPASS:
        this.inputSyncBypass = value;
        break;
      default:
        super.writeUint32(offset, value);
    }
  }

  control(value) {
    for (const machine of this.machines) {
      machine.enabled = !!(value & (1 << machine.index));
      if (value & (1 << (4 + machine.index))) machine.restart();
      if (value & (1 << (8 + machine.index))) machine.dividerPhase = 0;
    }
    this.running = this.machines.filter((machine) => machine.enabled);
    this.touch();
  }

  writeMachine(offset, value) {
    const machine = this.machines[Math.floor(offset / SM_STRIDE)];
    switch (offset % SM_STRIDE) {
      case CLKDIV:
        // 16.8 bits; an integer part of 0 stands for 65536.
        machine.divider = value >>> 16 ? value >>> 8 : 0x1000000;
        break;
      case EXECCTRL:
        machine.execCtrl = value & 0x7fffffff;
        machine.configured();
        break;
      case SHIFTCTRL:
        machine.setShiftCtrl(value);
        break;
      case INSTR:
        machine.force(value & 0xffff);
        this.reportPins();
        break;
      case PINCTRL:
        machine.pinCtrl = value;
        machine.configured();
        break;
    }
  }

  writeFifo(machine, value) {
    if (machine.tx.full) {
      this.fdebug |= TXOVER << machine.index;
      return;
    }
    machine.tx.push(value);
    this.fifoChanged(machine);
  }
}

/** `old` with `count` bits from `base` on, around the end, taken from `value`. */
function merge(old, value, base, count) {
  const field = count >= 32 ? 0xffffffff : (1 << count) - 1;
  const rotate = (bits) => (base ? (bits << base) | (bits >>> (32 - base)) : bits);
  const mask = rotate(field);
  return ((old & ~mask) | (rotate(value & field) & mask)) & PINS;
}

function fifoStatus({ tx, rx }) {
  return (tx.empty ? 1 << 24 : 0) | (tx.full ? 1 << 16 : 0) | (rx.empty ? 1 << 8 : 0) | (rx.full ? 1 : 0);
}
