// The controller that talks to the flash by itself, for commands: what a Winbond flash answers to some of them.
//
// # Design
// One byte comes back for each that goes out, or, in the mode that reads (TMOD 3), as many as are wanted after the command.
// A command ends when the controller is switched off.
//
// Stock answers every read with what the flash's status is.
import { BasePeripheral } from '../stock.mjs';

const CTRLR0 = 0x00;
const CTRLR1 = 0x04;
const SSIENR = 0x08;
const SR = 0x28;
const DR0 = 0x60;
const DR_END = 0xf0;

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

  writeUint32(offset, value) {
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
