// Arithmetic, logic and shifts, and the flags that they set.
//
// The stock interpreter is wrong about some flags: shifts by a register that holds 0 or more than 32, and ADCS
// and SBCS at the borders.
import { FAULT, MemoryAccess } from './memory.mjs';

export class Alu extends MemoryAccess {
  setNZ(result) {
    this.N = result < 0;
    this.Z = result === 0;
  }

  /** a + b + carry with all flags; for a − b give ~b. */
  add(a, b, carry) {
    const unsigned = (a >>> 0) + (b >>> 0) + carry;
    const result = unsigned | 0;
    this.N = result < 0;
    this.Z = result === 0;
    this.C = unsigned > 0xffffffff;
    this.V = ((a ^ result) & (b ^ result)) < 0;
    return result;
  }

  /** Shifts by an amount from a register: 0 changes nothing, 32 and more are allowed. */
  shift(kind, value, amount) {
    let result = value | 0;
    if (amount > 0) {
      const ror = amount & 31;
      switch (kind) {
        case 0b00:
          this.C = amount <= 32 && !!((value >>> (32 - amount)) & 1);
          result = amount < 32 ? value << amount : 0;
          break;
        case 0b01:
          this.C = amount <= 32 && !!((value >>> (amount - 1)) & 1);
          result = amount < 32 ? (value >>> amount) | 0 : 0;
          break;
        case 0b10:
          this.C = !!((value >> Math.min(amount - 1, 31)) & 1);
          result = value >> Math.min(amount, 31);
          break;
        default:
          result = ror ? (value >>> ror) | (value << (32 - ror)) : value | 0;
          this.C = result < 0;
      }
    }
    this.setNZ(result);
    return result;
  }

  condition(code) {
    switch (code) {
      case 0:
        return this.Z;
      case 1:
        return !this.Z;
      case 2:
        return this.C;
      case 3:
        return !this.C;
      case 4:
        return this.N;
      case 5:
        return !this.N;
      case 6:
        return this.V;
      case 7:
        return !this.V;
      case 8:
        return this.C && !this.Z;
      case 9:
        return !this.C || this.Z;
      case 10:
        return this.N === this.V;
      case 11:
        return this.N !== this.V;
      case 12:
        return !this.Z && this.N === this.V;
      default:
        return this.Z || this.N !== this.V;
    }
  }

  dataProcessing(operation, d, m) {
    const r = this.registers;
    switch (operation) {
      case 0b0000:
        this.setNZ((r[d] &= r[m]) | 0);
        break;
      case 0b0001:
        this.setNZ((r[d] ^= r[m]) | 0);
        break;
      case 0b0010:
        r[d] = this.shift(0b00, r[d], r[m] & 0xff);
        break;
      case 0b0011:
        r[d] = this.shift(0b01, r[d], r[m] & 0xff);
        break;
      case 0b0100:
        r[d] = this.shift(0b10, r[d], r[m] & 0xff);
        break;
      case 0b0101:
        r[d] = this.add(r[d], r[m], this.C ? 1 : 0);
        break;
      case 0b0110:
        r[d] = this.add(r[d], ~r[m], this.C ? 1 : 0);
        break;
      case 0b0111:
        r[d] = this.shift(0b11, r[d], r[m] & 0xff);
        break;
      case 0b1000:
        this.setNZ(r[d] & r[m]);
        break;
      case 0b1001:
        r[d] = this.add(0, ~r[m], 1);
        break;
      case 0b1010:
        this.add(r[d], ~r[m], 1);
        break;
      case 0b1011:
        this.add(r[d], r[m], 0);
        break;
      case 0b1100:
        this.setNZ((r[d] |= r[m]) | 0);
        break;
      case 0b1101:
        this.setNZ((r[d] = Math.imul(r[d], r[m])) | 0);
        break;
      case 0b1110:
        this.setNZ((r[d] &= ~r[m]) | 0);
        break;
      default:
        this.setNZ((r[d] = ~r[m]) | 0);
    }
    return 1;
  }

  extend(kind, d, value) {
    switch (kind & 3) {
      case 0:
        this.registers[d] = (value << 16) >> 16;
        break;
      case 1:
        this.registers[d] = (value << 24) >> 24;
        break;
      case 2:
        this.registers[d] = value & 0xffff;
        break;
      default:
        this.registers[d] = value & 0xff;
    }
    return 1;
  }

  reverse(kind, d, value) {
    const swapped = ((value & 0x00ff00ff) << 8) | ((value >>> 8) & 0x00ff00ff);
    if (kind === 0b000) this.registers[d] = (swapped << 16) | (swapped >>> 16);
    else if (kind === 0b001) this.registers[d] = swapped;
    else if (kind === 0b011) this.registers[d] = (swapped << 16) >> 16;
    else throw FAULT;
    return 1;
  }
}
