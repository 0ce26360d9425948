// The private peripheral bus: NVIC and system control block.
//
// Stock keeps what NVIC_ISPR pends for ever, lets NVIC_ICPR clear only what no peripheral can raise, and does not know
// AIRCR, by which software resets the chip.
import { RPPPB } from '../stock.mjs';

const NVIC_ISPR = 0x200;
const NVIC_ICPR = 0x280;
const AIRCR = 0xd0c;
const AIRCR_KEY = 0x05fa;
const SYSRESETREQ = 1 << 2;

export class Ppb extends RPPPB {
  /** `reset` is called when software asks for a reset. */
  constructor(rp2040, name, reset) {
    super(rp2040, name);
    this.requestReset = reset;
  }

  readUint32(offset) {
    if (offset === AIRCR) return 0xfa050000;
    return super.readUint32(offset);
  }

  writeUint32(offset, value) {
    switch (offset) {
      case NVIC_ISPR:
        this.rp2040.core.pend(value, true);
        return;
      case NVIC_ICPR:
        this.rp2040.core.pend(value, false);
        return;
      case AIRCR:
        if (value >>> 16 === AIRCR_KEY && value & SYSRESETREQ) this.requestReset();
        return;
      default:
        super.writeUint32(offset, value);
    }
  }
}
