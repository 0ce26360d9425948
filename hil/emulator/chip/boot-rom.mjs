// What firmware finds of the boot ROM: its mark, and a table of functions. Those that copy, erase, program and leave for the boot loader are there; all others do nothing
// but return. The boot itself is not played.
import { BOOT_REQUEST, FLASH_REQUEST } from './ssi.mjs';

const code = (name) => name.charCodeAt(0) | (name.charCodeAt(1) << 8);
const word = (value) => [value & 0xffff, value >>> 16];

const RETURN = 0x4c;
const COPY = 0x50;
const LOOK_UP = 0x80;
const TABLE = 0xa0;
const ERASE = 0xd0;
const PROGRAM = 0xe0;
const BOOT_LOADER = 0xf0;

/** Thumb code and words by address. */
const CODE = {
  // Returns.
  [RETURN]: [0x4770],
  // Copies r2 bytes, a multiple of four, from r1 to r0.
  [COPY]: [0x2a00, 0xd003, 0x3a04, 0x588b, 0x5083, 0xe7f9, 0x4770],
  // Looks up function r1: r2 goes through the table, whose last entry is that of all others.
  [LOOK_UP]: [0x4a04, 0x6813, 0x428b, 0xd003, 0x2b00, 0xd001, 0x3208, 0xe7f8, 0x6850, 0x4770, ...word(TABLE)],
  [TABLE]: [
    ['C4', COPY],
    ['RE', ERASE],
    ['RP', PROGRAM],
    ['UB', BOOT_LOADER],
    [null, RETURN],
  ].flatMap(([name, address]) => [...word(name ? code(name) : 0), ...word(address | 1)]),
  // Erases r1 bytes of flash from r0 on: r3 = FLASH_REQUEST; r0, r1 and 0 go there.
  [ERASE]: [0x4b02, 0x6018, 0x6059, 0x2000, 0x6098, 0x4770, ...word(FLASH_REQUEST)],
  // Programs r2 bytes of flash from r0 on with those at r1: r3 = FLASH_REQUEST; r0, r2 and r1 go there.
  [PROGRAM]: [0x4b02, 0x6018, 0x605a, 0x6099, 0x4770, 0xbf00, ...word(FLASH_REQUEST)],
  // Leaves for the boot loader: r3 = BOOT_REQUEST; anything goes there, and nothing comes after it.
  [BOOT_LOADER]: [0x4b01, 0x6018, 0xe7fe, 0xbf00, ...word(BOOT_REQUEST)],
};

/** The words from address 0 on. */
export function bootRom() {
  const bytes = Buffer.alloc(0x100);
  bytes.write('Mu\x01\x03', 0x10, 'latin1');
  bytes.writeUInt16LE(TABLE, 0x14); // table of functions: the one that looks up does not need it
  bytes.writeUInt16LE(TABLE, 0x16);
  bytes.writeUInt16LE(LOOK_UP | 1, 0x18);
  for (const [address, code] of Object.entries(CODE)) {
    code.forEach((opcode, index) => bytes.writeUInt16LE(opcode, Number(address) + 2 * index));
  }
  return new Uint32Array(bytes.buffer, bytes.byteOffset, bytes.length / 4);
}
