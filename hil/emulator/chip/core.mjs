// The Cortex-M0+ core: what the stock one lacks around its instructions.
//
// # Design
// Each mend is one override; what the stock core does wrong stands with it.
import { CortexM0Core } from '../stock.mjs';

const FIRST_IRQ = 16;
const LOWEST_PRIORITY = 4;

export class Core extends CortexM0Core {
  constructor(rp2040) {
    super(rp2040);
    /** Interrupt lines that peripherals hold high. */
    this.lines = 0;
    /** Interrupts that software has made pending. */
    this.pended = 0;
  }

  /**
   * A peripheral's interrupt line. Stock drops an interrupt that software has pended when the line falls, and
   * enters the handler from within the peripheral's register access when the core sleeps, even with PRIMASK set.
   */
  setInterrupt(irq, level) {
    const bit = 1 << irq;
    if (level) this.lines |= bit;
    else this.lines &= ~bit;
    this.updatePending(bit);
  }

  /** Software makes the interrupts in `bits` pending (NVIC_ISPR), or no longer (NVIC_ICPR). */
  pend(bits, pending) {
    if (pending) this.pended |= bits;
    else this.pended &= ~bits;
    this.updatePending(bits);
  }

  updatePending(bits) {
    const before = this.pendingInterrupts;
    this.pendingInterrupts = (before & ~bits) | ((this.lines | this.pended) & bits);
    if (this.pendingInterrupts & ~before) {
      this.interruptsUpdated = true;
      if (this.waiting && this.wakes()) this.waiting = false;
    }
  }

  /** Whether something pending ends a WFI or WFE; PRIMASK does not keep it from doing so. */
  wakes() {
    const primask = this.PM;
    this.PM = false;
    const wakes = this.nextException() !== 0;
    this.PM = primask;
    return wakes;
  }

  /** The exception to enter now, or 0. */
  nextException() {
    if (this.pendingNMI) return 2;
    const current = Math.min(this.exceptionPriority(this.IPSR), this.PM ? 0 : LOWEST_PRIORITY);
    const interrupts = this.pendingInterrupts & this.enabledInterrupts;
    for (let priority = 0; priority < current; priority++) {
      if (this.pendingSVCall && priority === this.svCallPriority) return 11;
      if (this.pendingPendSV && priority === this.pendSVPriority) return 14;
      if (this.pendingSystick && priority === this.systickPriority) return 15;
      const level = interrupts & this.interruptPriorities[priority];
      if (level) return FIRST_IRQ + (31 - Math.clz32(level & -level));
    }
    return 0;
  }

  checkForInterrupts() {
    const number = this.nextException();
    if (number === 0) {
      this.interruptsUpdated = false;
      return false;
    }
    if (number === 2) this.pendingNMI = false;
    else if (number === 11) this.pendingSVCall = false;
    else if (number === 14) this.pendingPendSV = false;
    else if (number === 15) this.pendingSystick = false;
    this.exceptionEntry(number);
    return true;
  }

  /** Stock never takes back what software has pended: the handler is entered for ever. */
  exceptionEntry(number) {
    if (number >= FIRST_IRQ) this.pend(1 << (number - FIRST_IRQ), false);
    super.exceptionEntry(number);
  }

  /** WFI or WFE: sleeps unless something is pending already. */
  sleep() {
    this.waiting = !this.wakes();
  }
}
