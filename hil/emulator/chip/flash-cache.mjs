// The cache between flash and CPU: 16 kB, two lines of 8 bytes per set (RP2040 data sheet, 2.6.3), of which the one
// that was used last stays.
//
// # Tradeoffs
// How long a miss takes depends on the flash, its clock and what it was read for last; here each one takes as long: 60 cycles,
// about eight bytes over four lines at half of 125 MHz with address and wait.
const FLASH = 0x10000000;
const FLASH_SPAN = 0x1000000;
const LINE_BITS = 3;
const SETS = 1024;

export const MISS_CYCLES = 60;

export class FlashCache {
  constructor(missCycles = MISS_CYCLES) {
    this.missCycles = missCycles;
    this.recent = new Int32Array(SETS).fill(-1);
    this.older = new Int32Array(SETS).fill(-1);
    /** Reads of flash by the CPU, and how many of them missed. */
    this.reads = 0;
    this.misses = 0;
  }

  /** The CPU reads at `address`. Returns the cycles for which it waits: none if that is not in flash. */
  read(address) {
    const offset = (address >>> 0) - FLASH;
    if (offset < 0 || offset >= FLASH_SPAN) return 0;
    this.reads++;
    const line = offset >>> LINE_BITS;
    const set = line % SETS;
    if (this.recent[set] === line) return 0;
    const hit = this.older[set] === line;
    this.older[set] = this.recent[set];
    this.recent[set] = line;
    if (hit) return 0;
    this.misses++;
    return this.missCycles;
  }
}
