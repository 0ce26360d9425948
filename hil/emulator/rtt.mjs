// The debugger's end of RTT channel 0: the log of the firmware, as bytes (defmt encodes it).
const CONTROL_BLOCK = '_SEGGER_RTT';
const RAM = 0x20000000;
const RAM_SIZE = 264 * 1024;
/** Of the first up-channel: name, buffer, size, write offset, read offset, flags. */
const CHANNEL = 24;

export class Rtt {
  constructor({ symbols }) {
    this.block = symbols.find(({ name }) => name === CONTROL_BLOCK)?.address;
  }

  /** Takes what the firmware has written since the last call. Empty before the firmware has set it up. */
  take(mcu) {
    if (this.block === undefined) return Buffer.alloc(0);
    const channel = this.block + CHANNEL;
    const buffer = mcu.readUint32(channel + 4);
    const size = mcu.readUint32(channel + 8);
    const write = mcu.readUint32(channel + 12);
    const read = mcu.readUint32(channel + 16);
    const valid = buffer >= RAM && buffer + size <= RAM + RAM_SIZE && write < size && read < size;
    if (!valid || read === write) return Buffer.alloc(0);
    const bytes = mcu.sram.subarray(buffer - RAM, buffer - RAM + size);
    mcu.writeUint32(channel + 16, write);
    return read < write
      ? Buffer.from(bytes.subarray(read, write))
      : Buffer.concat([bytes.subarray(read), bytes.subarray(0, write)]);
  }
}
