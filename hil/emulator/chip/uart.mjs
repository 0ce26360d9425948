// The PL011 UART with its FIFOs, interrupts and the time that a character takes.
//
// Stock sends a byte in no time and always says that it could send more, interrupts with every byte that comes
// instead of at the FIFO's level or after a pause, and has no overrun.
import { FIFO, RPUART } from '../stock.mjs';

const DR = 0x00;
const RSR = 0x04;
const FR = 0x18;
const LCR_H = 0x2c;
const IFLS = 0x34;
const IMSC = 0x38;
const RIS = 0x3c;
const MIS = 0x40;
const ICR = 0x44;
const DMACR = 0x48;

const FR_TXFE = 1 << 7;
const FR_RXFF = 1 << 6;
const FR_TXFF = 1 << 5;
const FR_RXFE = 1 << 4;
const FR_BUSY = 1 << 3;

const INT_RX = 1 << 4;
const INT_TX = 1 << 5;
const INT_RX_TIMEOUT = 1 << 6;
const INT_OVERRUN = 1 << 10;

const DR_OVERRUN = 1 << 11;

/** Receiver and transmitter on, the whole off. */
const CR_RESET = 0x300;

const DEPTH = 32;
/** Levels that IFLS chooses from: 1/8, 1/4, 1/2, 3/4, 7/8. */
const LEVELS = [4, 8, 16, 24, 28];
/** The line is silent for that many bits before the receiver says so. */
const TIMEOUT_BITS = 32;

export class Uart extends RPUART {
  constructor(rp2040, name, irq, dreq) {
    super(rp2040, name, irq, dreq);
    /** Bytes that were lost because the FIFO was full. */
    this.overruns = 0;
    this.sent = rp2040.clock.createAlarm(() => this.byteSent());
    this.silent = rp2040.clock.createAlarm(() => {
      if (!this.rxFIFO.empty) this.raise(INT_RX_TIMEOUT);
    });
    this.reset();
  }

  /** Everything as it is after a reset. */
  reset() {
    this.ctrlRegister = CR_RESET;
    this.lineCtrlRegister = 0;
    this.intDivisor = 0;
    this.fracDivisor = 0;
    this.interruptMask = 0;
    this.rxFIFO = new FIFO(DEPTH);
    this.txFIFO = new FIFO(DEPTH);
    this.levels = 0x12;
    this.dmaControl = 0;
    this.raw = 0;
    this.shifting = -1;
    this.overrun = false;
    this.sent.cancel();
    this.silent.cancel();
    this.checkInterrupts();
  }

  /** Bits of a character with start, stop and parity bits. */
  get frameBits() {
    const { lineCtrlRegister } = this;
    const stopBits = lineCtrlRegister & 0x08 ? 2 : 1;
    return 1 + this.wordLength + (lineCtrlRegister & 0x02 ? 1 : 0) + stopBits;
  }

  /** Nanoseconds that a bit takes, or 0 if the rate is not set. */
  get bitNanos() {
    return this.baudDivider ? (16e9 * this.baudDivider) / this.rp2040.clkPeri : 0;
  }

  get depth() {
    return this.fifosEnabled ? DEPTH : 1;
  }

  get txLevel() {
    return this.fifosEnabled ? LEVELS[this.levels & 7] : 0;
  }

  get rxLevel() {
    return this.fifosEnabled ? LEVELS[(this.levels >> 3) & 7] : 1;
  }

  checkInterrupts() {
    this.rp2040.setInterrupt(this.irq, !!(this.raw & this.interruptMask));
  }

  raise(interrupts) {
    this.raw |= interrupts;
    this.checkInterrupts();
  }

  lower(interrupts) {
    this.raw &= ~interrupts;
    this.checkInterrupts();
  }

  /** The next byte goes to the shift register. */
  shift() {
    if (this.shifting >= 0 || this.txFIFO.empty || !this.enabled || !this.txEnabled || !this.bitNanos) return;
    this.shifting = this.txFIFO.pull();
    if (this.txFIFO.itemCount === this.txLevel) this.raise(INT_TX);
    this.sent.schedule(this.frameBits * this.bitNanos);
  }

  byteSent() {
    const byte = this.shifting;
    this.shifting = -1;
    this.onByte?.(byte);
    this.shift();
  }

  /** A byte has come in: its stop bit is through. */
  receive(byte) {
    if (!this.enabled || !this.rxEnabled) return;
    if (this.rxFIFO.itemCount >= this.depth) {
      this.overruns++;
      this.overrun = true;
      this.raise(INT_OVERRUN);
    } else {
      this.rxFIFO.push(byte | (this.overrun ? DR_OVERRUN : 0));
      this.overrun = false;
      if (this.rxFIFO.itemCount >= this.rxLevel) this.raise(INT_RX);
    }
    this.silent.schedule(TIMEOUT_BITS * this.bitNanos);
  }

  readUint32(offset) {
    switch (offset) {
      case DR: {
        const word = this.rxFIFO.pull();
        const done = this.rxFIFO.empty ? INT_RX_TIMEOUT : 0;
        this.lower(done | (this.rxFIFO.itemCount < this.rxLevel ? INT_RX : 0));
        return word;
      }
      case RSR:
        return 0;
      case FR:
        return (
          (this.txFIFO.empty ? FR_TXFE : 0) |
          (this.txFIFO.itemCount >= this.depth ? FR_TXFF : 0) |
          (this.rxFIFO.empty ? FR_RXFE : 0) |
          (this.rxFIFO.itemCount >= this.depth ? FR_RXFF : 0) |
          (this.shifting >= 0 || !this.txFIFO.empty ? FR_BUSY : 0)
        );
      case IFLS:
        return this.levels;
      case RIS:
        return this.raw;
      case MIS:
        return this.raw & this.interruptMask;
      case DMACR:
        return this.dmaControl;
    }
    return super.readUint32(offset);
  }

  writeUint32(offset, value) {
    switch (offset) {
      case DR:
        if (this.txFIFO.itemCount < this.depth) this.txFIFO.push(value & 0xff);
        this.shift();
        if (this.txFIFO.itemCount > this.txLevel) this.lower(INT_TX);
        return;
      case LCR_H:
        super.writeUint32(offset, value);
        if (!this.fifosEnabled) {
          this.rxFIFO.reset();
          this.txFIFO.reset();
        }
        return;
      case IFLS:
        this.levels = value & 0x3f;
        return;
      case IMSC:
        this.interruptMask = value & 0x7ff;
        this.checkInterrupts();
        return;
      case ICR:
        this.lower(this.rawWriteValue);
        return;
      case DMACR:
        // The firmware moves bytes by interrupt; requests to the DMA are not made.
        this.dmaControl = value & 7;
        return;
    }
    super.writeUint32(offset, value);
    this.shift();
  }
}
