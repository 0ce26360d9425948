// The firmware's PIO programs, played here and by an independent emulator: the same state after every instruction.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import fs from 'node:fs';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { Pio } from '../chip/pio.mjs';
import { randomFrom } from '../random.mjs';
import { Box, step, withoutFirmware } from '../rig/box.mjs';

const PYTHON = fileURLToPath(new URL('../.venv/bin/python', import.meta.url));
const TRACE = fileURLToPath(new URL('../oracle/trace.py', import.meta.url));
const CYCLES = 5000;

const skip =
  withoutFirmware ||
  (fs.existsSync(PYTHON) ? false : 'no .venv: python3 -m venv .venv && .venv/bin/pip install -r requirements.txt');

/** The PIO of the firmware, set up for a run: of state machine 0 either program. */
function booted(pace) {
  const box = new Box().hello();
  box.load([step({ proj: [0, 100], cam: [100, 200], period: 1000 })], 5, pace);
  box.request('arm');
  return box.machine.chip.mcu.pio[0];
}

/** A PIO by itself with the instructions and the configuration of `from`'s machine `index`. */
function alone(from, index) {
  const bus = { dma: { setDREQ() {}, clearDREQ() {} }, setInterrupt() {} };
  const pio = new Pio(bus, 'PIO', 0, 0, { ticked: 0, expect() {}, outputsChanged() {} }, { lazy: false });
  pio.instructions.set(from.instructions);
  const [source, machine] = [from.machines[index], pio.machines[index]];
  for (const register of ['execCtrl', 'pinCtrl']) machine[register] = source[register];
  machine.setShiftCtrl(source.shiftCtrl);
  pio.control(1 << index);
  return { pio, machine };
}

/** Levels of `pin` that change at random, by cycle: short and long, and changes in a row. */
function levelsOf(pin, random) {
  const levels = [];
  for (let level = 0; levels.length <= CYCLES + 40; level ^= 1) {
    const length = random() < 0.3 ? 1 : 1 + Math.floor(random() * 40);
    for (let i = 0; i < length; i++) levels.push(level << pin);
  }
  return levels;
}

/** Plays both for CYCLES cycles from `entry` and compares. */
function compare(from, index, entry, { words = [], inputPin, seed }) {
  const random = randomFrom(seed);
  const { pio, machine } = alone(from, index);
  const inputs = levelsOf(inputPin, random);
  const { pinCtrl, shiftCtrl, inBase } = machine;
  // The oracle knows no base of the inputs: its pins are turned so that ours is 0.
  const turned = (pin) => (pin - inBase) & 31;
  const turn = (bits) => (inBase ? (bits >>> inBase) | (bits << (32 - inBase)) : bits) >>> 0;
  const outBase = pinCtrl & 31;
  const outCount = (pinCtrl >> 20) & 63;
  const directions = outCount ? (((1 << outCount) - 1) << outBase) >>> 0 : 0;
  const x = 0xffffffff;

  const job = {
    opcodes: [...pio.instructions],
    options: {
      auto_pull: machine.autopull,
      auto_push: !!(shiftCtrl & (1 << 16)),
      pull_threshold: machine.pullThreshold,
      push_threshold: machine.pushThreshold,
      shift_isr_right: !!(shiftCtrl & (1 << 18)),
      shift_osr_right: !!(shiftCtrl & (1 << 19)),
      out_base: turned(outBase),
      out_count: outCount,
      jmp_pin: turned(machine.jmpPin),
      wrap_target: machine.wrapBottom,
      wrap_top: machine.wrapTop,
    },
    state: { program_counter: entry, x_register: x, pin_directions: turn(directions) },
    words,
    inputs: inputs.map(turn),
    cycles: CYCLES,
  };
  const { stdout, stderr, status } = spawnSync(PYTHON, [TRACE], {
    input: JSON.stringify(job),
    maxBuffer: 1 << 27,
  });
  assert.equal(status, 0, stderr.toString());
  const rows = JSON.parse(stdout);

  machine.pc = entry;
  machine.x = x;
  let fed = 0;
  // As the firmware does it: the first word is pulled in before the start. (The oracle fills an empty register
  // only in cycles of an `out`; the data sheet, and the Pio here, in all cycles.)
  if (words.length) {
    machine.osr = words[fed++];
    machine.osrCount = 0;
  }
  let cycle = 0;
  let pushed = [];
  const visited = new Set();
  for (const [clock, pc, rowX, rowY, osr, osrCount, isr, isrCount, pins, received] of rows) {
    for (; cycle < clock; cycle++) {
      while (!machine.tx.full && fed < words.length) machine.tx.push(words[fed++]);
      pio.inputs = inputs[cycle];
      visited.add(machine.pc);
      pio.tick();
      while (!machine.rx.empty) pushed.push(machine.rx.pull());
    }
    assert.deepEqual(
      { pc: machine.pc, x: machine.x, y: machine.y, osr: machine.osr, osrCount: machine.osrCount },
      { pc, x: rowX, y: rowY, osr, osrCount },
      `after cycle ${clock}`,
    );
    assert.deepEqual({ isr: machine.isr, isrCount: machine.isrCount, pushed }, { isr, isrCount, pushed: received });
    assert.equal(turn(pio.pinValues & directions), pins, `pins after cycle ${clock}`);
    pushed = [];
  }
  assert.ok(cycle >= CYCLES);
  return visited;
}

/** Words of random levels and random counts, mostly short. */
function randomWords(seed, shift) {
  const random = randomFrom(seed);
  return Array.from({ length: CYCLES }, () => {
    const count = random() < 0.5 ? 0 : Math.floor(random() * 30);
    return (count * 2 ** shift + Math.floor(random() * 2 ** shift)) >>> 0;
  });
}

test('the free-running program plays words as the oracle does', { skip }, () => {
  const pio = booted();
  const { wrapBottom } = pio.machines[0];
  for (const seed of [1, 2, 3]) {
    // Enters at once, and three instructions before, where it waits for SYNC.
    for (const entry of [wrapBottom, wrapBottom - 3]) {
      compare(pio, 0, entry, { words: randomWords(seed, 2), inputPin: 4, seed });
    }
  }
});

test('the paced program plays words and waits as the oracle does', { skip }, () => {
  const pio = booted({ paced: true });
  const { wrapBottom, wrapTop } = pio.machines[0];
  for (const seed of [1, 2, 3]) {
    const visited = compare(pio, 0, wrapBottom, { words: randomWords(seed, 3), inputPin: 4, seed });
    // The four before wait for SYNC.
    assert.equal(visited.size, wrapTop - wrapBottom + 1 + 4, 'every instruction was played');
  }
});

test('the edge counters count and push as the oracle does', { skip }, () => {
  const pio = booted();
  for (const [index, inputPin] of [[1, 5], [2, 4]]) {
    const { wrapBottom } = pio.machines[index];
    for (const seed of [1, 2, 3]) {
      for (const entry of [wrapBottom, wrapBottom + 4]) compare(pio, index, entry, { inputPin, seed });
    }
  }
});
