// Where the CPU spends its cycles, by function.
//
// # Tradeoffs
// Code that the compiler has put into its caller counts as the caller's.
/** Where code can be: flash and RAM, in halfwords. */
const REGIONS = [
  { start: 0x10000000, halfwords: 1 << 23 },
  { start: 0x20000000, halfwords: 0x42000 / 2 },
];

export class Profile {
  constructor({ symbols }) {
    this.functions = symbols
      .filter(({ isFunction }) => isFunction)
      .sort((a, b) => a.address - b.address);
    this.cycles = new Map();
    this.counts = REGIONS.map(({ halfwords }) => new Float64Array(halfwords));
    this.elsewhere = 0;
  }

  /** The instruction at `address` has taken `cycles`. */
  count(address, cycles) {
    for (let region = 0; region < REGIONS.length; region++) {
      const index = (address - REGIONS[region].start) >> 1;
      if (index >= 0 && index < REGIONS[region].halfwords) {
        this.counts[region][index] += cycles;
        return;
      }
    }
    this.elsewhere += cycles;
  }

  /** `[[function, cycles], …]`, the most first. */
  samples() {
    const totals = new Map();
    const add = (name, cycles) => totals.set(name, (totals.get(name) ?? 0) + cycles);
    let at = 0;
    this.counts.forEach((counts, region) => {
      counts.forEach((cycles, index) => {
        if (cycles === 0) return;
        const address = REGIONS[region].start + 2 * index;
        while (at + 1 < this.functions.length && this.functions[at + 1].address <= address) at++;
        const known = this.functions[at] && this.functions[at].address <= address;
        add(known ? this.functions[at].name : '?', cycles);
      });
    });
    if (this.elsewhere) add('outside of flash and RAM', this.elsewhere);
    return [...totals].sort((a, b) => b[1] - a[1]);
  }
}
