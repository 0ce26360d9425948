// The host's end of the UART: bytes on the way to the device, one after the other at its baud rate.
//
// # Design
// The line exists whether the chip runs or not, so its bytes are events of the world, in cycles, and outlive a
// reset. A byte takes the time of a character at the rate that the device has set when it is sent.
const DEFAULT_BAUD = 921_600;
const DEFAULT_BITS = 10;

export class UartLine {
  /** `machine` has the world's events and the chip. */
  constructor(machine) {
    this.machine = machine;
    /** Bytes on the way, and which of them comes next. */
    this.queue = [];
    this.next = 0;
    /** The cycle, with a fraction, at which the line is free. */
    this.free = 0;
  }

  get uart() {
    return this.machine.chip.uart;
  }

  get characterCycles() {
    const { bitNanos, frameBits } = this.uart;
    const nanos = bitNanos ? bitNanos * frameBits : (DEFAULT_BITS * 1e9) / DEFAULT_BAUD;
    return (nanos * this.machine.chip.mcu.clkSys) / 1e9;
  }

  /** Sends `bytes`, not before `cycle`. Returns the cycle at which the last one arrives. */
  send(bytes, cycle) {
    let at = Math.max(this.free, cycle);
    const idle = this.next === this.queue.length;
    for (const byte of bytes) {
      at += this.characterCycles;
      this.queue.push({ byte, arrives: Math.round(at) });
    }
    this.free = at;
    if (idle) this.expectNext();
    return Math.round(at);
  }

  /** Only the next byte is an event of the world, however many are on the way. */
  expectNext() {
    if (this.next === this.queue.length) {
      this.queue = [];
      this.next = 0;
      return;
    }
    const { byte, arrives } = this.queue[this.next];
    this.machine.world.at(arrives, () => {
      this.next++;
      this.uart.receive(byte);
      this.expectNext();
    });
  }
}
