// How the CPU reaches memory: RAM and flash as arrays, everything else through the bus, nothing else at all.
//
// Stock answers a read from nowhere with all ones and drops a write to it; the real bus raises a fault, as it
// does for an address that is not aligned.
import { Core } from './core.mjs';

const RAM = 0x20000000;
const FLASH = 0x10000000;
const BOOTROM_END = 0x4000;
/** Where there is code of the boot ROM (boot-rom.mjs). */
const ROM_CODE = 0x30;
const ROM_CODE_END = 0x100;
const DPRAM = 0x50100000;
const DPRAM_END = 0x50101000;
const APB = 0x4;
const SIO = 0xd;
const PPB = 0xe0000;

/** Thrown where an instruction cannot be executed. */
export const FAULT = new Error('hard fault');

/** A core that reaches memory, or throws FAULT where there is none. */
export class MemoryAccess extends Core {
  constructor(rp2040) {
    super(rp2040);
    const { sram, flash } = rp2040;
    this.ram32 = new Uint32Array(sram.buffer);
    this.ram16 = new Uint16Array(sram.buffer);
    this.ram8 = sram;
    this.flash32 = new Uint32Array(flash.buffer);
    this.flash16 = new Uint16Array(flash.buffer);
    this.flash8 = flash;
    /** The cache that flash is read through, or null if it takes no time. */
    this.cache = null;
    /** Cycles that flash was waited for. */
    this.flashWait = 0;
  }

  fetch(address) {
    const flash = (address - FLASH) >>> 1;
    if (flash < this.flash16.length) {
      if (this.cache !== null) this.flashWait += this.cache.read(address);
      return this.flash16[flash];
    }
    const ram = (address - RAM) >>> 1;
    if (ram < this.ram16.length) return this.ram16[ram];
    if (address >= ROM_CODE && address < ROM_CODE_END) return (this.rp2040.bootrom[address >>> 2] >>> (8 * (address & 2))) & 0xffff;
    throw FAULT;
  }

  read32(address) {
    address >>>= 0;
    if (address & 3) throw FAULT;
    const ram = (address - RAM) >>> 2;
    if (address >= RAM && ram < this.ram32.length) return this.ram32[ram];
    const flash = (address - FLASH) >>> 2;
    if (address >= FLASH && flash < this.flash32.length) {
      if (this.cache !== null) this.flashWait += this.cache.read(address);
      return this.flash32[flash];
    }
    return this.onBus(address).readUint32(address) >>> 0;
  }

  read16(address) {
    address >>>= 0;
    if (address & 1) throw FAULT;
    const ram = (address - RAM) >>> 1;
    if (address >= RAM && ram < this.ram16.length) return this.ram16[ram];
    const flash = (address - FLASH) >>> 1;
    if (address >= FLASH && flash < this.flash16.length) {
      if (this.cache !== null) this.flashWait += this.cache.read(address);
      return this.flash16[flash];
    }
    return this.onBus(address).readUint16(address);
  }

  read8(address) {
    address >>>= 0;
    const ram = address - RAM;
    if (ram >= 0 && ram < this.ram8.length) return this.ram8[ram];
    const flash = address - FLASH;
    if (flash >= 0 && flash < this.flash8.length) {
      if (this.cache !== null) this.flashWait += this.cache.read(address);
      return this.flash8[flash];
    }
    return this.onBus(address).readUint8(address);
  }

  write32(address, value) {
    address >>>= 0;
    if (address & 3) throw FAULT;
    const ram = (address - RAM) >>> 2;
    if (address >= RAM && ram < this.ram32.length) this.ram32[ram] = value;
    else this.onBus(address).writeUint32(address, value);
  }

  write16(address, value) {
    address >>>= 0;
    if (address & 1) throw FAULT;
    const ram = (address - RAM) >>> 1;
    if (address >= RAM && ram < this.ram16.length) this.ram16[ram] = value;
    else this.onBus(address).writeUint16(address, value);
  }

  write8(address, value) {
    address >>>= 0;
    const ram = address - RAM;
    if (ram >= 0 && ram < this.ram8.length) this.ram8[ram] = value;
    else this.onBus(address).writeUint8(address, value);
  }

  /** The bus, if something answers at `address`. */
  onBus(address) {
    const answers =
      this.rp2040.findPeripheral(address) !== undefined ||
      address >>> 28 === SIO ||
      address >>> 12 === PPB + 0xe ||
      (address >= DPRAM && address < DPRAM_END) ||
      address < BOOTROM_END ||
      (address >= FLASH && address < FLASH + 4 * this.flash8.length);
    if (!answers) throw FAULT;
    return this.rp2040;
  }

  // What the exceptions of the base class use.

  readUint32(address) {
    return this.read32(address);
  }

  writeUint32(address, value) {
    this.write32(address, value);
  }

  // Loads and stores with their cycles.

  /** Cycles of a single load or store: SIO is next to the core, the APB behind a bridge. */
  accessCycles(address, write) {
    const region = address >>> 28;
    if (region === SIO) return 1;
    if (region === APB) return write ? 5 : 4;
    return 2;
  }

  load32(d, address) {
    this.registers[d] = this.read32(address);
    return this.accessCycles(address, false);
  }

  load16(d, address) {
    this.registers[d] = this.read16(address);
    return this.accessCycles(address, false);
  }

  load8(d, address) {
    this.registers[d] = this.read8(address);
    return this.accessCycles(address, false);
  }

  store32(address, value) {
    this.write32(address, value);
    return this.accessCycles(address, true);
  }

  store16(address, value) {
    this.write16(address, value);
    return this.accessCycles(address, true);
  }

  store8(address, value) {
    this.write8(address, value);
    return this.accessCycles(address, true);
  }
}
