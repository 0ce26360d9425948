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
    for (const byte of bytes) {
      at += this.characterCycles;
      this.machine.world.at(Math.round(at), () => this.uart.receive(byte));
    }
    this.free = at;
    return Math.round(at);
  }
}
