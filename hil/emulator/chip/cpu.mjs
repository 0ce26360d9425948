// The instructions of ARMv6-M, with the cycles that they take on a Cortex-M0+, and its faults.
//
// # Design
// One switch over the top seven bits, which the formats divide evenly; RAM and flash are reached as arrays, all
// other addresses through the bus of rp2040js. An exception entry is a step of its own, so that its cycles
// pass before the handler begins.
//
// The stock interpreter tries some sixty comparisons per instruction, and knows no faults: what cannot be
// executed or reached is logged and passed over, so that a hard fault never comes.
//
// With a cache (flash-cache.mjs) an instruction takes longer by what its own code and its data have to be waited for.
//
// # Tradeoffs
// Without one code takes no time to come from flash. Buses are never contended, and nothing is fetched ahead.
import { Alu } from './alu.mjs';
import { FAULT } from './memory.mjs';

/** Cycles from an interrupt to its handler: Cortex-M0+ Technical Reference Manual. */
const ENTRY_CYCLES = 15;
/** Eight words off the stack and a new fetch; the manual gives no number. */
const RETURN_CYCLES = 11;
const HARD_FAULT = 3;
const NMI = 2;
const SP = 13;
const LR = 14;
const PC = 15;

export class Cpu extends Alu {
  /** Executes one instruction, or enters an exception. Returns the cycles that it takes. */
  executeInstruction() {
    if (this.interruptsUpdated && this.checkForInterrupts()) return ENTRY_CYCLES + this.waited();
    const address = this.registers[PC];
    try {
      return this.execute(address) + this.waited();
    } catch (error) {
      if (error !== FAULT) throw error;
      return this.hardFault(address) + this.waited();
    }
  }

  /** The cycles that flash was waited for since the last time. */
  waited() {
    const { flashWait } = this;
    this.flashWait = 0;
    return flashWait;
  }

  /** The instruction at `address` cannot be executed. A fault within a fault locks the core up. */
  hardFault(address) {
    const nested = this.IPSR === HARD_FAULT || this.IPSR === NMI;
    this.registers[PC] = address;
    try {
      if (nested) throw FAULT;
      this.exceptionEntry(HARD_FAULT);
    } catch (error) {
      if (error !== FAULT) throw error;
      // In lockup nothing but a reset helps: no interrupt has a higher priority.
      this.IPSR = HARD_FAULT;
      this.waiting = true;
      this.rp2040.onLockup(address);
    }
    return ENTRY_CYCLES;
  }

  exceptionEntry(number) {
    super.exceptionEntry(number);
    this.registers[PC] &= ~1;
  }

  /** Goes on at `address`, whose bit 0 says Thumb. Returns the cycles beyond those of the branch. */
  branchExchange(address) {
    if (this.currentMode === 1 && address >>> 28 === 0xf) {
      this.exceptionReturn(address & 0x0fffffff);
      this.registers[PC] &= ~1;
      return RETURN_CYCLES;
    }
    this.registers[PC] = address & ~1;
    if (!(address & 1)) throw FAULT;
    return 0;
  }

  execute(address) {
    const r = this.registers;
    const op = this.fetch(address);
    r[PC] = address + 2;
    const d = op & 7;
    const n = (op >> 3) & 7;
    switch (op >>> 9) {
      case 0: case 1: case 2: case 3: { // LSLS, MOVS
        const shift = (op >> 6) & 31;
        const value = r[n];
        if (shift) this.C = !!((value >>> (32 - shift)) & 1);
        this.setNZ((r[d] = value << shift) | 0);
        return 1;
      }
      case 4: case 5: case 6: case 7: // LSRS, 0 stands for 32
        r[d] = this.shift(0b01, r[n], (op >> 6) & 31 || 32);
        return 1;
      case 8: case 9: case 10: case 11: // ASRS, 0 stands for 32
        r[d] = this.shift(0b10, r[n], (op >> 6) & 31 || 32);
        return 1;
      case 12:
        r[d] = this.add(r[n], r[(op >> 6) & 7], 0);
        return 1;
      case 13:
        r[d] = this.add(r[n], ~r[(op >> 6) & 7], 1);
        return 1;
      case 14:
        r[d] = this.add(r[n], (op >> 6) & 7, 0);
        return 1;
      case 15:
        r[d] = this.add(r[n], ~((op >> 6) & 7), 1);
        return 1;
      case 16: case 17: case 18: case 19: // MOVS
        this.setNZ((r[(op >> 8) & 7] = op & 0xff));
        return 1;
      case 20: case 21: case 22: case 23: // CMP
        this.add(r[(op >> 8) & 7], ~(op & 0xff), 1);
        return 1;
      case 24: case 25: case 26: case 27: // ADDS
        r[(op >> 8) & 7] = this.add(r[(op >> 8) & 7], op & 0xff, 0);
        return 1;
      case 28: case 29: case 30: case 31: // SUBS
        r[(op >> 8) & 7] = this.add(r[(op >> 8) & 7], ~(op & 0xff), 1);
        return 1;
      case 32: case 33:
        return this.dataProcessing((op >> 6) & 15, d, n);
      case 34: case 35:
        return this.high(op);
      case 36: case 37: case 38: case 39: // LDR literal
        r[(op >> 8) & 7] = this.read32(((address + 4) & ~3) + ((op & 0xff) << 2));
        return 2;
      case 40:
        return this.store32(r[n] + r[(op >> 6) & 7], r[d]);
      case 41:
        return this.store16(r[n] + r[(op >> 6) & 7], r[d]);
      case 42:
        return this.store8(r[n] + r[(op >> 6) & 7], r[d]);
      case 43: { // LDRSB
        const at = r[n] + r[(op >> 6) & 7];
        r[d] = (this.read8(at) << 24) >> 24;
        return this.accessCycles(at, false);
      }
      case 44:
        return this.load32(d, r[n] + r[(op >> 6) & 7]);
      case 45:
        return this.load16(d, r[n] + r[(op >> 6) & 7]);
      case 46:
        return this.load8(d, r[n] + r[(op >> 6) & 7]);
      case 47: { // LDRSH
        const at = r[n] + r[(op >> 6) & 7];
        r[d] = (this.read16(at) << 16) >> 16;
        return this.accessCycles(at, false);
      }
      case 48: case 49: case 50: case 51:
        return this.store32(r[n] + ((op >> 4) & 0x7c), r[d]);
      case 52: case 53: case 54: case 55:
        return this.load32(d, r[n] + ((op >> 4) & 0x7c));
      case 56: case 57: case 58: case 59:
        return this.store8(r[n] + ((op >> 6) & 31), r[d]);
      case 60: case 61: case 62: case 63:
        return this.load8(d, r[n] + ((op >> 6) & 31));
      case 64: case 65: case 66: case 67:
        return this.store16(r[n] + ((op >> 5) & 0x3e), r[d]);
      case 68: case 69: case 70: case 71:
        return this.load16(d, r[n] + ((op >> 5) & 0x3e));
      case 72: case 73: case 74: case 75:
        return this.store32(r[SP] + ((op & 0xff) << 2), r[(op >> 8) & 7]);
      case 76: case 77: case 78: case 79:
        return this.load32((op >> 8) & 7, r[SP] + ((op & 0xff) << 2));
      case 80: case 81: case 82: case 83: // ADR
        r[(op >> 8) & 7] = ((address + 4) & ~3) + ((op & 0xff) << 2);
        return 1;
      case 84: case 85: case 86: case 87: // ADD Rd, SP
        r[(op >> 8) & 7] = r[SP] + ((op & 0xff) << 2);
        return 1;
      case 88: // ADD SP, SUB SP
        if (op & 0x100) throw FAULT;
        r[SP] += op & 0x80 ? -((op & 0x7f) << 2) : (op & 0x7f) << 2;
        return 1;
      case 89: // SXTH, SXTB, UXTH, UXTB
        if (op & 0x100) throw FAULT;
        return this.extend((op >> 6) & 7, d, r[n]);
      case 90:
        return this.push(op & 0x1ff);
      case 91: // CPSIE i, CPSID i
        if ((op & 0x1ef) !== 0x062) throw FAULT;
        this.PM = !!(op & 0x10);
        this.interruptsUpdated = true;
        return 1;
      case 93:
        return this.reverse((op >> 6) & 7, d, r[n]);
      case 94:
        return this.pop(op & 0x1ff);
      case 95:
        return op & 0x100 ? this.hint(op) : this.breakpoint(op, address);
      case 96: case 97: case 98: case 99:
        return this.storeMultiple((op >> 8) & 7, op & 0xff);
      case 100: case 101: case 102: case 103:
        return this.loadMultiple((op >> 8) & 7, op & 0xff);
      case 104: case 105: case 106: case 107: case 108: case 109: case 110: // B with a condition
        if (!this.condition((op >> 8) & 15)) return 1;
        r[PC] = address + 4 + ((op << 24) >> 23);
        return 2;
      case 111: // UDF, SVC
        if (!(op & 0x100)) throw FAULT;
        this.pendingSVCall = true;
        this.interruptsUpdated = true;
        return 1;
      case 112: case 113: case 114: case 115: // B
        r[PC] = address + 4 + ((op << 21) >> 20);
        return 2;
      case 120: case 121: case 122: case 123:
        return this.wide(op, this.fetch(address + 2), address);
      default:
        throw FAULT;
    }
  }

  /** ADD, CMP and MOV of all registers, BX and BLX. */
  high(op) {
    const r = this.registers;
    const m = (op >> 3) & 15;
    const d = ((op >> 4) & 8) | (op & 7);
    const value = m === PC ? r[PC] + 2 : r[m];
    switch ((op >> 8) & 3) {
      case 0b01:
        this.add(r[d], ~value, 1);
        return 1;
      case 0b11:
        if (op & 7) throw FAULT;
        if (op & 0x80) r[LR] = r[PC] | 1;
        return 2 + this.branchExchange(value);
    }
    const result = op & 0x200 ? value : (d === PC ? r[PC] + 2 : r[d]) + value;
    r[d] = d === PC ? result & ~1 : d === SP ? result & ~3 : result;
    return d === PC ? 2 : 1;
  }

  push(list) {
    const r = this.registers;
    let count = 0;
    for (let bits = list; bits; bits &= bits - 1) count++;
    let at = r[SP] - 4 * count;
    const bottom = at;
    for (let i = 0; i < 8; i++) {
      if (!(list & (1 << i))) continue;
      this.write32(at, r[i]);
      at += 4;
    }
    if (list & 0x100) this.write32(at, r[LR]);
    r[SP] = bottom;
    return 1 + count;
  }

  pop(list) {
    const r = this.registers;
    let at = r[SP];
    let count = 0;
    for (let i = 0; i < 8; i++) {
      if (!(list & (1 << i))) continue;
      r[i] = this.read32(at);
      at += 4;
      count++;
    }
    if (!(list & 0x100)) {
      r[SP] = at;
      return 1 + count;
    }
    const target = this.read32(at);
    r[SP] = at + 4;
    return 4 + count + this.branchExchange(target);
  }

  storeMultiple(n, list) {
    const r = this.registers;
    let at = r[n];
    let count = 0;
    for (let i = 0; i < 8; i++) {
      if (!(list & (1 << i))) continue;
      this.write32(at, r[i]);
      at += 4;
      count++;
    }
    r[n] = at;
    return 1 + count;
  }

  loadMultiple(n, list) {
    const r = this.registers;
    let at = r[n];
    let count = 0;
    for (let i = 0; i < 8; i++) {
      if (!(list & (1 << i))) continue;
      r[i] = this.read32(at);
      at += 4;
      count++;
    }
    if (!(list & (1 << n))) r[n] = at;
    return 1 + count;
  }

  hint(op) {
    switch (op & 0xff) {
      case 0x20: // WFE
        if (this.eventRegistered) this.eventRegistered = false;
        else this.sleep();
        return 2;
      case 0x30: // WFI
        this.sleep();
        return 2;
      case 0x40: // SEV
        this.eventRegistered = true;
        return 1;
      default: // NOP, YIELD
        return 1;
    }
  }

  /** No debugger is there, but the one who runs this chip wants to know. */
  breakpoint(op, address) {
    this.registers[PC] = address;
    this.rp2040.onBreak(op & 0xff);
    return 1;
  }

  /** BL, barriers, MRS and MSR. */
  wide(op, op2, address) {
    const r = this.registers;
    r[PC] = address + 4;
    if ((op2 & 0xd000) === 0xd000) {
      const sign = (op << 21) >> 31;
      const i1 = ~((op2 >> 13) ^ sign) & 1;
      const i2 = ~((op2 >> 11) ^ sign) & 1;
      r[LR] = (address + 4) | 1;
      r[PC] = address + 4 + ((sign << 24) | (i1 << 23) | (i2 << 22) | ((op & 0x3ff) << 12) | ((op2 & 0x7ff) << 1));
      return 3;
    }
    if (op === 0xf3bf && (op2 & 0xff00) === 0x8f00) return 3;
    if (op === 0xf3ef && op2 >> 12 === 0x8) {
      r[(op2 >> 8) & 15] = this.readSpecialRegister(op2 & 0xff);
      return 3;
    }
    if (op >> 4 === 0xf38 && op2 >> 8 === 0x88) {
      this.writeSpecialRegister(op2 & 0xff, r[op & 15]);
      return 3;
    }
    throw FAULT;
  }
}
