import assert from 'node:assert/strict';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { parseElf, parseUf2, readImage } from '../image.mjs';
import { ELF, withoutFirmware } from '../rig/box.mjs';

/** UF2 blocks of 256 bytes. */
function uf2({ segments }) {
  const blocks = [];
  for (const { address, bytes } of segments) {
    for (let at = 0; at < bytes.length; at += 256) {
      const part = bytes.subarray(at, at + 256);
      const block = Buffer.alloc(512);
      block.writeUInt32LE(0x0a324655, 0);
      block.writeUInt32LE(0x9e5d5157, 4);
      block.writeUInt32LE(address + at, 12);
      block.writeUInt32LE(part.length, 16);
      part.copy(block, 32);
      blocks.push(block);
    }
  }
  return Buffer.concat(blocks);
}

function flash({ segments }) {
  const memory = Buffer.alloc(1 << 21, 0xff);
  for (const { address, bytes } of segments) memory.set(bytes, address - 0x10000000);
  return memory;
}

test('an image is the same as ELF and as UF2', { skip: withoutFirmware }, () => {
  const image = readImage(ELF);
  assert.ok(flash(image).equals(flash(parseUf2(uf2(image)))));
});

test('an ELF has the vector table where the chip looks for it, and symbols', { skip: withoutFirmware }, () => {
  const image = readImage(ELF);
  const memory = flash(image);
  assert.equal(memory.readUInt32LE(0x100) >>> 16, 0x2004, 'the stack begins at the end of RAM');
  const reset = image.symbols.find(({ name }) => name === 'Reset');
  assert.equal(memory.readUInt32LE(0x104), reset.address + 1);
});

test('what is no image is refused in one sentence', () => {
  const directory = fs.mkdtempSync(path.join(os.tmpdir(), 'image-'));
  const file = (name, bytes) => {
    const full = path.join(directory, name);
    fs.writeFileSync(full, bytes);
    return full;
  };
  const elf = Buffer.alloc(100);
  elf.writeUInt32BE(0x7f454c46, 0);
  elf.set([1, 1], 4);
  assert.throws(() => readImage(path.join(directory, 'none.elf')), /none\.elf: cannot be read \(ENOENT\)/);
  assert.throws(() => readImage(file('text.elf', 'hello')), /text\.elf: expected an ELF file/);
  assert.throws(() => readImage(file('empty.elf', elf)), /empty\.elf: the image is empty/);
  assert.throws(() => readImage(file('odd.uf2', Buffer.alloc(100))), /odd\.uf2: expected UF2 blocks of 512 bytes/);
  assert.throws(() => readImage(file('bad.uf2', Buffer.alloc(512))), /bad\.uf2: expected a UF2 block at byte 0/);
  elf.writeUInt32LE(0xffff, 28);
  elf.writeUInt16LE(1, 44);
  assert.throws(() => parseElf(elf), RangeError);
  assert.throws(() => readImage(file('cut.elf', elf)), /cut\.elf: the file is cut short/);
  const block = uf2({ segments: [{ address: 0x20000000, bytes: Buffer.alloc(256) }] });
  assert.throws(() => parseUf2(block), /expected only flash, found a segment at 0x20000000/);
  fs.rmSync(directory, { recursive: true });
});
