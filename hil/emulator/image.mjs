// Firmware images: ELF with symbols, and UF2.
//
// # Design
// An image is what it writes to flash, `[{ address, bytes }]`, and the symbols that it names. The loader of
// the chip's boot ROM is not played: the chip starts at the vector table behind the second-stage boot loader.
import fs from 'node:fs';

export const FLASH = 0x10000000;
const FLASH_END = 0x11000000;

const ELF_MAGIC = 0x7f454c46;
const PT_LOAD = 1;
const SHT_SYMTAB = 2;
const STT_FUNC = 2;
const UF2_MAGIC = [0x0a324655, 0x9e5d5157];
const UF2_BLOCK = 512;

/** Reads the image in `path`; its name says which format it has. */
export function readImage(path) {
  let bytes;
  try {
    bytes = fs.readFileSync(path);
  } catch (error) {
    throw new Error(`${path}: cannot be read (${error.code})`);
  }
  try {
    return path.endsWith('.uf2') ? parseUf2(bytes) : parseElf(bytes);
  } catch (error) {
    throw new Error(`${path}: ${error instanceof RangeError ? 'the file is cut short' : error.message}`);
  }
}

/** 32-bit little-endian ELF: the loadable segments by their physical addresses, and the symbols. */
export function parseElf(file) {
  if (file.length < 52 || file.readUInt32BE(0) !== ELF_MAGIC) throw new Error('expected an ELF file');
  if (file[4] !== 1 || file[5] !== 1) throw new Error('expected a 32-bit little-endian ELF file');
  const segments = [];
  const [programHeaders, size, count] = [file.readUInt32LE(28), file.readUInt16LE(42), file.readUInt16LE(44)];
  for (let i = 0; i < count; i++) {
    const header = programHeaders + i * size;
    if (file.readUInt32LE(header) !== PT_LOAD) continue;
    const offset = file.readUInt32LE(header + 4);
    const address = file.readUInt32LE(header + 12);
    const length = file.readUInt32LE(header + 16);
    if (length === 0) continue;
    segments.push({ address, bytes: slice(file, offset, length) });
  }
  return { segments: inFlash(segments), symbols: parseSymbols(file) };
}

function parseSymbols(file) {
  const symbols = [];
  const [sectionHeaders, size, count] = [file.readUInt32LE(32), file.readUInt16LE(46), file.readUInt16LE(48)];
  for (let i = 0; i < count; i++) {
    const header = sectionHeaders + i * size;
    if (file.readUInt32LE(header + 4) !== SHT_SYMTAB) continue;
    const table = file.readUInt32LE(header + 16);
    const end = table + file.readUInt32LE(header + 20);
    const names = file.readUInt32LE(sectionHeaders + file.readUInt32LE(header + 24) * size + 16);
    for (let entry = table; entry < end; entry += 16) {
      const start = names + file.readUInt32LE(entry);
      const name = file.toString('latin1', start, file.indexOf(0, start));
      const isFunction = (file[entry + 12] & 0xf) === STT_FUNC;
      const address = file.readUInt32LE(entry + 4);
      // Bit 0 of a function's address says Thumb.
      if (name) symbols.push({ name, address: isFunction ? (address & ~1) >>> 0 : address, isFunction });
    }
  }
  return symbols;
}

/** UF2: blocks of 512 bytes that say where they belong. It has no symbols. */
export function parseUf2(file) {
  if (file.length === 0 || file.length % UF2_BLOCK) throw new Error('expected UF2 blocks of 512 bytes');
  const segments = [];
  for (let block = 0; block < file.length; block += UF2_BLOCK) {
    if (UF2_MAGIC.some((magic, i) => file.readUInt32LE(block + 4 * i) !== magic)) {
      throw new Error(`expected a UF2 block at byte ${block}`);
    }
    segments.push({
      address: file.readUInt32LE(block + 12),
      bytes: slice(file, block + 32, Math.min(file.readUInt32LE(block + 16), 476)),
    });
  }
  return { segments: inFlash(segments), symbols: [] };
}

function slice(file, offset, length) {
  if (offset + length > file.length) throw new Error('the file is cut short');
  return file.subarray(offset, offset + length);
}

function inFlash(segments) {
  for (const { address, bytes } of segments) {
    if (address < FLASH || address + bytes.length > FLASH_END) {
      throw new Error(`expected only flash, found a segment at 0x${address.toString(16)}`);
    }
  }
  if (segments.length === 0) throw new Error('the image is empty');
  return segments;
}
