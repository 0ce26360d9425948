// What firmware finds of the boot ROM: its mark, and a table of functions that are there and do nothing but return, except for
// the one that copies. The boot itself is not played.

const COPY = 'C4'.charCodeAt(0) | ('C4'.charCodeAt(1) << 8);

/** Thumb code by address. */
const CODE = {
  // Looks up function r1: the one that copies, or the one that returns.
  0x30: [0x4a03, 0x4291, 0xd002, 0x204c, 0x3001, 0x4770, 0x2051, 0x4770],
  0x40: [COPY, 0],
  // Returns.
  0x4c: [0x4770],
  // Copies r2 bytes, a multiple of four, from r1 to r0.
  0x50: [0x2a00, 0xd003, 0x3a04, 0x588b, 0x5083, 0xe7f9, 0x4770],
};

/** The words from address 0 on. */
export function bootRom() {
  const bytes = Buffer.alloc(0x80);
  bytes.write('Mu\x01\x03', 0x10, 'latin1');
  bytes.writeUInt16LE(0x60, 0x14); // table of functions: the one that looks up does not need it
  bytes.writeUInt16LE(0x60, 0x16);
  bytes.writeUInt16LE(0x31, 0x18);
  for (const [address, code] of Object.entries(CODE)) {
    code.forEach((opcode, index) => bytes.writeUInt16LE(opcode, Number(address) + 2 * index));
  }
  return new Uint32Array(bytes.buffer, bytes.byteOffset, bytes.length / 4);
}
