// The flash is written by the boot ROM: what the firmware keeps there is there after the power was off.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import { test } from 'node:test';
import { readImage } from '../image.mjs';
import { Box, ELF, crc32, frame, kept, loading, step, varint, withoutFirmware } from '../rig/box.mjs';

const skip = withoutFirmware;
const HZ = 125_000_000;
const OUTPUTS = [2, 3, 6, 7];
const CAM = 3;
const SECTOR = 0x1ff000;
const SCHEDULE = SECTOR - 512 * 256;
const STEP = step({ proj: [0, 1250], cam: [1000, 10_000], period: 125_000 });

const levels = (box) => OUTPUTS.map((pin) => box.machine.wires.levels[pin]);
const rises = (box) => box.edges.filter(([, pin, level]) => pin === CAM && level).map(([cycle]) => cycle);

/** Lets the box keep a table of three steps that is played `runs` times. */
function store(box, runs) {
  const asked = [['repeat', varint(runs)], ...loading([STEP, STEP, STEP]), ['arm'], ['start']];
  const bytes = asked.flatMap(([name, fields]) => kept(name, fields));
  const about = [HZ, 3, 0, runs, bytes.length, crc32(bytes)].flatMap(varint);
  const page = (number, content) => box.request('store', [...varint(number), ...varint(content.length), ...content]);
  page(0, []);
  for (let at = 0; at < bytes.length; at += 256) page(16 + at / 256, bytes.slice(at, at + 256));
  page(0, frame(about));
  return about;
}

for (const link of ['uart', 'usb']) {
  test(`over ${link}: a polarity that is kept holds at once and over a power-down`, { skip }, () => {
    const box = new Box({ link, bootMs: 70 }).hello();
    box.request('keep', [0, 1, 0, 0]);
    assert.deepEqual(levels(box), [0, 1, 0, 0]);
    box.request('keepAux', [1, 0, 0, 0]);
    box.power(70);
    assert.deepEqual(levels(box), [0, 1, 1, 0]);
    assert.deepEqual([...box.machine.warnings.keys()].filter((warning) => warning.startsWith('flash')), []);
    box.hello().request('keep', [0, 0, 0, 0]);
    box.power(70);
    assert.deepEqual(levels(box), [0, 0, 1, 0]);
  });

  test(`over ${link}: a schedule that is kept runs from a power-up on, until it is forgotten`, { skip }, () => {
    const box = new Box({ link, bootMs: 70 }).hello();
    const about = store(box, 2);
    assert.deepEqual(box.request('stored').slice(1), [1, ...about]);
    assert.deepEqual(rises(box), []);
    box.power().run(HZ / 10);
    const cam = rises(box);
    assert.equal(cam.length, 6);
    assert.deepEqual([0, 1, 3, 4].map((k) => cam[k + 1] - cam[k]), [125_000, 125_000, 125_000, 125_000]);
    // It is all the same to it whether a host comes.
    box.hello();
    assert.deepEqual(box.request('stored').slice(1), [1, ...about]);
    box.request('store', [...varint(0), ...varint(0)]);
    assert.deepEqual(box.request('stored').slice(1), [0]);
    box.power().run(HZ / 10);
    assert.deepEqual(rises(box), []);
  });
}

test('after a reset that is none of the power nothing runs', { skip }, () => {
  const box = new Box().hello();
  store(box, 0);
  box.power().run(HZ / 100);
  assert.ok(rises(box).length > 0);
  // A hang, which the watchdog ends.
  const loop = 0x20041000;
  box.machine.chip.mcu.writeUint16(loop, 0xe7fe);
  box.machine.jump(loop, 0, 1);
  assert.equal(box.run(HZ), 'reset');
  box.edges.length = 0;
  box.run(HZ / 10);
  assert.deepEqual(rises(box), []);
  box.hello();
  assert.equal(box.request('stored')[1], 1);
});

test('one bit that is lost of a schedule, and nothing runs', { skip }, () => {
  const box = new Box().hello();
  store(box, 0);
  box.machine.chip.mcu.flash[SCHEDULE + 16 * 256 + 40] ^= 4;
  box.power().run(HZ / 10);
  assert.deepEqual(rises(box), []);
  assert.deepEqual(box.hello().request('stored').slice(1), [0]);
});

const OTHER = `${ELF}-200mhz`;
const skipUpdate = skip || (fs.existsSync(OTHER) ? false : `no other firmware at ${OTHER}`);

test('it leaves for its boot loader, takes another firmware and comes back with what it kept', { skip: skipUpdate }, () => {
  const box = new Box().hello();
  box.request('keep', [0, 1, 0, 0]);
  store(box, 0);
  const clock = (hz) => Buffer.from(box.request('describe')).includes(Buffer.from(varint(hz)));
  assert.ok(clock(HZ) && !clock(200_000_000));
  box.request('boot');
  assert.equal(box.run(HZ / 5), 'boot');
  // There the outputs float.
  assert.ok(OUTPUTS.every((pin) => !box.machine.wires.isDriven(pin)));
  assert.equal(box.run(HZ), 'cycles');
  box.machine.take(readImage(OTHER));
  box.run(HZ / 5);
  box.edges.length = 0;
  box.hello();
  assert.ok(clock(200_000_000) && !clock(HZ));
  assert.deepEqual(levels(box), [0, 1, 0, 0]);
  // What was meant for another clock is not run, nor after an update.
  box.run(HZ / 10);
  assert.deepEqual(rises(box), []);
  assert.deepEqual(box.request('stored').slice(1), [0]);
});

test('an update does not begin a schedule that is kept', { skip }, () => {
  const box = new Box().hello();
  store(box, 0);
  box.request('boot');
  assert.equal(box.run(HZ / 5), 'boot');
  box.machine.take(readImage(ELF));
  box.run(HZ / 5);
  assert.deepEqual(rises(box), []);
  assert.equal(box.hello().request('stored')[1], 1);
  box.power().run(HZ / 50);
  assert.ok(rises(box).length > 0);
});
