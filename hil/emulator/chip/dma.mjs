// DMA channels that take time: one word per cycle and channel.
//
// The stock channel moves its whole block within the cycle in which it is triggered (as long as the FIFO has
// room), and moves a word for a request that has been taken back in the meantime.
import { RPDMAChannel } from '../stock.mjs';

/** The request that is always there. */
const TREQ_PERMANENT = 63;

class PacedChannel extends RPDMAChannel {
  constructor(dma, rp2040, index) {
    super(dma, rp2040, index);
    this.transferAlarm = rp2040.clock.createAlarm(() => {
      if (this.requested || this.dma.getTimer(this.treqValue)) this.transfer();
    });
  }

  get requested() {
    return this.treqValue === TREQ_PERMANENT || !!this.dma.dreq[this.treqValue];
  }

  scheduleTransfer() {
    if (this.requested) this.transferAlarm.scheduleCycles(1);
    else super.scheduleTransfer();
  }
}

/** Brings `dma` to its reset state; the requests of the peripherals stay. */
export function resetDma(dma) {
  for (const channel of dma.channels) channel.transferAlarm.cancel();
  paceDma(dma);
  Object.assign(dma, { intRaw: 0, intEnable0: 0, intForce0: 0, intEnable1: 0, intForce1: 0 });
  Object.assign(dma, { timer0: 0, timer1: 0, timer2: 0, timer3: 0 });
  dma.checkInterrupts();
}

/** Gives `dma` channels that take time. */
export function paceDma(dma) {
  dma.channels = dma.channels.map((_, index) => new PacedChannel(dma, dma.rp2040, index));
}
