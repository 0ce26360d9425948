// Where the CPU spends its cycles, by function.
//
// # Tradeoffs
// Code that the compiler has put into its caller counts as the caller's.
const FLASH = 0x10000000;
const HALFWORDS = 1 << 23;

export class Profile {
  constructor({ symbols }) {
    this.functions = symbols
      .filter(({ isFunction }) => isFunction)
      .sort((a, b) => a.address - b.address);
    this.cycles = new Map();
    this.counts = new Float64Array(HALFWORDS);
    this.elsewhere = 0;
  }

  /** The instruction at `address` has taken `cycles`. */
  count(address, cycles) {
    const index = (address - FLASH) >> 1;
    if (index >= 0 && index < HALFWORDS) this.counts[index] += cycles;
    else this.elsewhere += cycles;
  }

  /** `[[function, cycles], …]`, the most first. */
  samples() {
    const totals = new Map();
    const add = (name, cycles) => totals.set(name, (totals.get(name) ?? 0) + cycles);
    let at = 0;
    this.counts.forEach((cycles, index) => {
      if (cycles === 0) return;
      const address = FLASH + 2 * index;
      while (at + 1 < this.functions.length && this.functions[at + 1].address <= address) at++;
      const known = this.functions[at] && this.functions[at].address <= address;
      add(known ? this.functions[at].name : '?', cycles);
    });
    if (this.elsewhere) add('outside of flash', this.elsewhere);
    return [...totals].sort((a, b) => b[1] - a[1]);
  }
}
