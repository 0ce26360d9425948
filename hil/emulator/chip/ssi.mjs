// The controller that talks to the flash by itself, for commands: what a Winbond flash answers to some of them.
//
// # Design
// One byte comes back for each that goes out, or, in the mode that reads (TMOD 3), as many as are wanted after the command.
// A command ends when the controller is switched off.
//
// What the boot ROM has the flash do, erase and program, it asks for in one piece at a place where silicon has nothing: where in the flash, how
// many bytes, and the address of what is to be written, 0 for nothing. It takes no time. Programming makes zeros of ones only.
//
// Stock answers every read with what the flash's status is, and has no flash that is written.
import { BasePeripheral } from '../stock.mjs';

const CTRLR0 = 0x00;
const CTRLR1 = 0x04;
const SSIENR = 0x08;
const SR = 0x28;
const DR0 = 0x60;
const DR_END = 0xf0;

/** The place, and its three words: from, length, source. */
export const FLASH_REQUEST = 0x18000100;
const REQUEST = FLASH_REQUEST & 0xfff;

/** What is written here leaves for the boot loader. */
export const BOOT_REQUEST = FLASH_REQUEST + 0x10;

const SECTOR = 4096;
const PAGE = 256;

const SR_TFNF = 1 << 1;
const SR_TFE = 1 << 2;
const SR_RFNE = 1 << 3;

const READ_STATUS_1 = 0x05;
const READ_STATUS_2 = 0x35;
const READ_UNIQUE_ID = 0x4b;
const QUAD_ENABLED = 1 << 1;

export class Ssi extends BasePeripheral {
  /** `uniqueId` are the 8 bytes that the flash was made with. */
  constructor(rp2040, name, uniqueId) {
    super(rp2040, name);
    this.values = new Map();
    /** The boot loader is to be entered. */
    this.onBootLoader = () => {};
    this.answers = {
      [READ_STATUS_1]: [0, 0],
      [READ_STATUS_2]: [0, QUAD_ENABLED],
      [READ_UNIQUE_ID]: [0, 0, 0, 0, 0, ...uniqueId],
    };
    this.end();
  }

  end() {
    this.sent = [];
    this.received = [];
  }

  /** The byte that comes with the next one that goes out. */
  get answer() {
    return this.answers[this.sent[0]]?.[this.sent.length - 1] ?? 0;
  }

  exchange(byte) {
    this.sent.push(byte);
    this.received.push(this.answer);
  }

  readUint32(offset) {
    if (offset === SR) return SR_TFNF | SR_TFE | (this.received.length ? SR_RFNE : 0);
    if (offset >= DR0 && offset < DR_END) return this.received.shift() ?? 0;
    return this.values.get(offset) ?? 0;
  }

  /** Erases or programs, as the boot ROM wants it: whole sectors, or whole pages. */
  change(from, length, source) {
    const { flash } = this.rp2040;
    const unit = source ? PAGE : SECTOR;
    if (from % unit || length % unit || from + length > flash.length) {
      this.rp2040.logger.warn('flash', `${length} bytes from 0x${from.toString(16)} are no whole ${source ? 'pages' : 'sectors'}`);
      return;
    }
    if (!source) flash.fill(0xff, from, from + length);
    for (let at = 0; source && at < length; at++) flash[from + at] &= this.rp2040.readUint8(source + at);
  }

  writeUint32(offset, value) {
    if (offset === (BOOT_REQUEST & 0xfff)) {
      this.onBootLoader();
      return;
    }
    if (offset >= REQUEST) {
      this.values.set(offset, value >>> 0);
      const [from, length] = [0, 4].map((word) => this.values.get(REQUEST + word));
      if (offset === REQUEST + 8) this.change(from, length, value >>> 0);
      return;
    }
    if (offset >= DR0 && offset < DR_END) {
      const reads = (this.values.get(CTRLR0) >> 8) & 3;
      if (reads !== 3) this.exchange(value & 0xff);
      else {
        this.sent.push(value & 0xff);
        for (let left = (this.values.get(CTRLR1) ?? 0) + 1; left > 0; left--) this.exchange(0);
      }
      return;
    }
    this.values.set(offset, value >>> 0);
    if (offset === SSIENR && !(value & 1)) this.end();
  }
}
