import assert from 'node:assert/strict';
import { test } from 'node:test';
import { FlashCache, MISS_CYCLES } from '../chip/flash-cache.mjs';
import { Machine } from '../machine.mjs';
import { imageOf } from '../rig/rigs.mjs';

const FLASH = 0x10000000;
const WAY = 8192;

test('a line is eight bytes, and a set has two', () => {
  const cache = new FlashCache();
  const waits = (...addresses) => addresses.map((address) => cache.read(FLASH + address) / MISS_CYCLES);
  assert.deepEqual(waits(0, 4, 7, 8, 0), [1, 0, 0, 1, 0]);
  assert.deepEqual(waits(WAY, 0, 2 * WAY, 0, WAY), [1, 0, 1, 0, 1], 'the one that was used last stays');
  assert.equal(cache.read(0x20000000), 0, 'RAM is no flash');
  assert.deepEqual([cache.reads, cache.misses], [10, 5]);
});

test('code in flash takes its time with a cache, once', () => {
  // Eight NOPs, and back to the first.
  const image = imageOf([...new Array(8).fill(0xbf00), 0xe7f6]);
  const busy = (flashCache, cycles) => {
    const machine = new Machine(image, { flashCache });
    machine.run(cycles);
    return machine.flashReads;
  };
  assert.deepEqual(busy(false, 1000), { reads: 0, misses: 0 });
  const { reads, misses } = busy(true, 1000);
  // Vectors of the boot, and the lines of the loop.
  assert.ok(misses >= 3 && misses <= 5, `${misses} misses`);
  assert.ok(reads > 600 && reads < 900, `${reads} reads`);
});
