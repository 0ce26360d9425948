// The real firmware in the machine: links, edges, resets, and that passing over cycles makes no difference.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { Profile } from '../profile.mjs';
import { Box, ELF, frame, step, unframe, withoutFirmware } from '../rig/box.mjs';

const MAIN = fileURLToPath(new URL('../main.mjs', import.meta.url));
const skip = withoutFirmware;
const HZ = 125_000_000;
const [PROJ, CAM, SYNC, STROBE] = [2, 3, 4, 5];
/** 9,523 steps per second. */
const STEP = step({ proj: [0, 1250], cam: [1000, 10_000], period: 13_125 });
const USB = { link: 'usb', bootMs: 70 };
const NOWHERE = 0x60000000;

const rises = (box, pin) => box.edges.filter(([, line, level]) => line === pin && level).map(([cycle]) => cycle);
const distances = (cycles) => new Set(cycles.slice(1).map((cycle, i) => cycle - cycles[i]));

test('frames of this test are those of the protocol', () => {
  // Request::Ping(42) in session 0x1234 with number 7: protocol/tests/wire_v1.rs
  const bytes = [0xb4, 0x24, 7, 2, 42];
  assert.equal(Buffer.from(frame(bytes)).toString('hex'), '0ab42407022a71dcf7e000');
  assert.deepEqual(unframe(frame(bytes).slice(0, -1)), bytes);
});

for (const options of [{ link: 'uart' }, USB]) {
  test(`over ${options.link}: all edges of a run are on their ticks`, { skip }, () => {
    const box = new Box(options).hello().load([STEP], 300);
    box.machine.setStrobe({ delay: 625, width: 8000 });
    box.start().run(300 * 13_125 + HZ / 100);
    const [proj, cam, strobe] = [PROJ, CAM, STROBE].map((pin) => rises(box, pin));
    assert.deepEqual([proj.length, cam.length, strobe.length], [300, 300, 300]);
    assert.deepEqual([...distances(cam)], [13_125]);
    assert.ok(cam.every((cycle, i) => cycle - proj[i] === 1000 && strobe[i] - cycle === 625));
    const falls = box.edges.filter(([, line, level]) => line === CAM && !level).map(([cycle]) => cycle);
    assert.ok(falls.every((cycle, i) => cycle - cam[i] === 10_000));
    assert.equal(box.machine.chip.uart.overruns, 0);
  });
}

test('a level is seen by the PIO in the cycle in which it is on the wire', { skip }, () => {
  const box = new Box().hello().load([STEP], 20, { paced: true });
  box.machine.setVsync({ first: box.machine.cycle + 200_000, period: 20_001, width: 500 });
  box.start().run(700_000);
  const [sync, proj] = [SYNC, PROJ].map((pin) => rises(box, pin));
  assert.equal(proj.length, 20);
  // The firmware's SYNC_LATENCY.
  assert.ok(proj.every((cycle, i) => cycle - sync[i] === 2));
});

test('with the input synchroniser the PIO sees a level two cycles later', { skip }, () => {
  const box = new Box({ inputSync: true }).hello().load([STEP], 20, { paced: true });
  box.machine.setVsync({ first: box.machine.cycle + 200_000, period: 20_001, width: 500 });
  box.start().run(700_000);
  const [sync, proj] = [SYNC, PROJ].map((pin) => rises(box, pin));
  assert.equal(proj.length, 20);
  assert.ok(proj.every((cycle, i) => cycle - sync[i] === 4));
});

test('nothing of a run waits for flash', { skip }, () => {
  const box = new Box({ flashCache: true }).hello().load([STEP], 100);
  const { machine } = box;
  assert.ok(machine.flashReads.reads > 10_000, 'the boot does');
  machine.setStrobe({ delay: 625, width: 8000 });
  const before = machine.flashReads.reads;
  box.start().run(100 * 13_125 + HZ / 100);
  assert.equal(rises(box, CAM).length, 100);
  assert.equal(machine.flashReads.reads, before);
});

test('the UART hears nothing while nobody is at it', { skip }, () => {
  const box = new Box(USB).hello();
  // Status: the second of its counters is that of corrupt frames.
  box.run(HZ / 10);
  const { gpio, uart } = box.machine.chip.mcu;
  assert.equal(gpio[1].pullupEnabled, true);
  assert.equal(uart[0].rxFIFO.itemCount, 0);
});

test('a probe that asks for every line of the log and then vanishes does not hold the box up', { skip }, () => {
  const box = new Box().hello();
  const { machine } = box;
  const { address } = machine.image.symbols.find(({ name }) => name === '_SEGGER_RTT');
  // The mode of the first channel up: behind 16 bytes of its mark, two counts and five fields of the channel.
  const MODE = 44;
  const BLOCK = 2;
  machine.chip.mcu.writeUint32(address + MODE, BLOCK);
  // Each of these is a line of the log.
  for (let i = 0; i < 200; i++) machine.send([1, 2, 3, 0]);
  assert.equal(box.run(HZ), 'cycles', 'nothing had to be reset');
  box.request('status');
});

test('pads are as the wiring wants them from the boot on', { skip }, () => {
  const { mcu } = new Box().machine.chip;
  const pad = (pin) => mcu.readUint32(0x4001c004 + 4 * pin);
  const [SLEW_FAST, SCHMITT, PULL_DOWN, PULL_UP, DRIVE_8MA] = [1, 2, 4, 8, 2 << 4];
  for (const pin of [PROJ, CAM]) assert.equal(pad(pin) & (0x30 | SLEW_FAST), DRIVE_8MA);
  for (const pin of [SYNC, STROBE]) {
    assert.equal(pad(pin) & (SCHMITT | PULL_DOWN | PULL_UP), SCHMITT | PULL_DOWN);
  }
  assert.equal(pad(1) & (SCHMITT | PULL_DOWN | PULL_UP), SCHMITT | PULL_UP);
});

/** What can be seen of a run; `cut(box)` lets the time pass. */
function trace(options, paced, cut) {
  const box = new Box({ ...options }).hello();
  box.load([STEP, step({ cam: [5, 50], period: 12_000 })], 40, { paced });
  const { machine } = box;
  machine.setStrobe({ delay: 111, width: 0, ignore: [3] });
  const first = machine.cycle + 200_000;
  machine.setVsync({ first, period: 20_000, width: 500, jitter: 900, seed: 5, missing: [7] });
  box.start();
  cut(box);
  return {
    edges: box.edges,
    bytes: box.bytes,
    busy: machine.busy,
    cycle: machine.cycle,
    registers: [...machine.core.registers],
    ram: Buffer.from(machine.chip.mcu.sram).toString('base64'),
  };
}

const whole = (box) => box.run(2_000_000);

for (const paced of [false, true]) {
  const kind = paced ? 'each step on a SYNC edge' : 'free-running';
  test(`${kind}: cycles that are passed over make no difference`, { skip }, () => {
    for (const link of [{ link: 'uart' }, USB]) {
      const lazy = trace(link, paced, whole);
      assert.ok(lazy.edges.length > 300);
      assert.deepEqual(trace({ ...link, lazy: false }, paced, whole), lazy);
    }
  });

  test(`${kind}: it does not matter in which pieces time passes`, { skip }, () => {
    const pieces = (box) => {
      const end = box.machine.cycle + 2_000_000;
      for (let piece = 1; box.machine.cycle < end; piece = (piece * 7 + 1) % 4001) {
        box.run(Math.min(piece, end - box.machine.cycle));
      }
    };
    assert.deepEqual(trace({}, paced, pieces), trace({}, paced, whole));
  });
}

/** A box in a run, with PROJ and CAM high. */
function runningBox(options) {
  const box = new Box(options).hello().load([STEP], 100_000).start();
  while (!(box.machine.wires.levels[PROJ] && box.machine.wires.levels[CAM])) box.run(HZ / 1000, ['edge']);
  box.edges.length = 0;
  return box;
}

/** The box answers after a reset, in a session that is new. */
function answersAnew(box, before) {
  box.bytes.length = 0;
  box.hello();
  assert.notEqual(box.session, before);
}

test('a hard fault drives the outputs low and resets the chip', { skip }, () => {
  const box = runningBox();
  const { session } = box;
  const at = box.machine.cycle;
  box.machine.jump(NOWHERE);
  assert.equal(box.run(HZ / 100), 'reset');
  assert.deepEqual(box.edges.map(([, ...edge]) => edge), [[PROJ, 0], [CAM, 0]]);
  assert.ok(box.edges[1][0] - at < 200, 'within a few instructions');
  assert.equal(box.run(HZ / 100), 'cycles');
  assert.deepEqual(box.edges.length, 2, 'and they stay low');
  answersAnew(box, session);
});

test('a CPU that hangs is reset by the watchdog, which brings the outputs to rest', { skip }, () => {
  const box = runningBox();
  const { session, machine } = box;
  const loop = 0x20041000;
  machine.chip.mcu.writeUint16(loop, 0xe7fe);
  machine.jump(loop, 0, 1);
  const at = machine.cycle;
  assert.equal(box.run(HZ), 'reset');
  const millis = (machine.cycle - at) / (HZ / 1000);
  assert.ok(millis > 490 && millis <= 500, `${millis} ms`);
  assert.deepEqual([...machine.wires.levels.slice(PROJ, CAM + 1)], [0, 0]);
  box.run(HZ / 100);
  answersAnew(box, session);
});

test('a USB cable can be pulled and put back', { skip }, () => {
  const box = new Box(USB).hello();
  box.machine.plug(false);
  box.run(HZ / 10);
  assert.throws(() => box.request('status', [], { limit: HZ / 10 }), /no answer/);
  box.machine.plug(true);
  box.run(HZ / 10);
  box.request('status');
});

test('USB moves at most 19 packets per millisecond', { skip }, () => {
  const box = new Box(USB).hello();
  const { mcu } = box.machine.chip;
  let packets = 0;
  const give = mcu.usbCtrl.giveOut.bind(mcu.usbCtrl);
  mcu.usbCtrl.giveOut = (...packet) => {
    packets++;
    give(...packet);
  };
  box.machine.send(new Array(64 * 100).fill(1));
  box.run(3 * (HZ / 1000));
  assert.ok(packets > 40 && packets <= 58, `${packets} packets in 3 ms`);
});

test('the command runs the firmware', { skip }, () => {
  const requests = [
    { op: 'run', cycles: 1_000_000 },
    { op: 'send', bytes: '04b424070aeffdb6f50d8ea23b4300' },
    { op: 'run', cycles: HZ / 10, until: ['frame'] },
    { op: 'stats' },
  ];
  const { stdout, status } = spawnSync(process.execPath, [MAIN, '--image', ELF], {
    input: requests.map((request) => `${JSON.stringify(request)}\n`).join(''),
  });
  assert.equal(status, 0);
  const [boot, sent, hello, stats] = stdout.toString().trim().split('\n').map((line) => JSON.parse(line));
  assert.deepEqual([boot.why, boot.received], ['cycles', '']);
  assert.notEqual(boot.rtt, '', 'the log of the boot');
  assert.equal(hello.why, 'frame');
  assert.ok(hello.cycle > sent.arrives);
  const identity = unframe([...Buffer.from(hello.received, 'hex')].slice(0, -1));
  // The nonce 0xdeadbeef comes back.
  assert.ok(Buffer.from(identity).toString('hex').includes('effdb6f50d'));
  assert.equal(stats.clock_hz, HZ);
});

test('the profile names the functions and counts every cycle', { skip }, () => {
  const box = new Box();
  const { machine } = box;
  machine.profile = new Profile(machine.image);
  const before = machine.busy;
  box.run(HZ / 100);
  const samples = machine.profile.samples();
  assert.equal(samples.reduce((sum, [, cycles]) => sum + cycles, 0), machine.busy - before);
  assert.ok(samples.some(([name]) => name === 'TIMER_IRQ_0'));
});

test('lines that nobody drives rest where the firmware pulls them, and have no edges', { skip }, () => {
  const box = new Box().hello();
  const levels = () => [SYNC, STROBE].map((pin) => box.machine.wires.levels[pin]);
  assert.deepEqual(levels(), [0, 0]);
  box.load([STEP], 1, { polarity: [0, 0, 1, 1] }).request('arm');
  assert.deepEqual(levels(), [1, 1]);
  assert.deepEqual(box.edges.filter(([, pin]) => pin === SYNC || pin === STROBE), []);
});

for (const [damage, levels] of [[0, [0, 1, 0, 1]], [1, [0, 0, 0, 0]]]) {
  test(`lines rest from the boot on as the flash keeps it${damage ? ', low where it is damaged' : ''}`, { skip }, () => {
    const box = new Box({ bootMs: 0 });
    // CAM and STROBE are active low: firmware/src/kept.rs
    const kept = (0x52434750 | 0b1010) >>> 0;
    const flash = new DataView(box.machine.chip.mcu.flash.buffer);
    flash.setUint32(0x1ff000, kept, true);
    flash.setUint32(0x1ff004, (~kept ^ damage) >>> 0, true);
    box.run(HZ / 50);
    assert.deepEqual([PROJ, CAM, SYNC, STROBE].map((pin) => box.machine.wires.levels[pin]), levels);
    // The first level that they are driven to is the one that stays.
    assert.equal(box.edges.length, levels[1]);
  });
}
