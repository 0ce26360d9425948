// The strobe and vsync models, and inputs by cycle.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { sleepingMachine } from '../rig/rigs.mjs';

const CAM = 3;
const SYNC = 4;
const STROBE = 5;

/** Pulses of `pin` as [rise, fall]. */
function pulses(machine, pin) {
  const found = [];
  for (let i = 0; i < machine.edges.length; i += 3) {
    const [cycle, line, level] = machine.edges.slice(i, i + 3);
    if (line !== pin) continue;
    if (level) found.push([cycle]);
    else found.at(-1)?.push(cycle);
  }
  return found;
}

/** A machine whose CAM has pulses of `width` at `rises`; it is driven from outside. */
function withCam(rises, width = 100) {
  const machine = sleepingMachine();
  for (const rise of rises) {
    machine.drive(CAM, 1, rise);
    machine.drive(CAM, 0, rise + width);
  }
  return machine;
}

test('STROBE follows CAM after its delay, for its width, but for the triggers that it ignores', () => {
  const machine = withCam([1000, 2000, 3000, 4000]);
  machine.setStrobe({ delay: 7, width: 300, ignore: [1, 2], extra: [2500] });
  machine.run(10_000);
  assert.deepEqual(pulses(machine, STROBE), [[1007, 1307], [2500, 2800], [4007, 4307]]);
});

test('a strobe of width 0 lasts as long as the CAM pulse', () => {
  const machine = withCam([1000, 2000], 55);
  machine.setStrobe({ delay: 10, width: 0 });
  machine.run(10_000);
  assert.deepEqual(pulses(machine, STROBE), [[1010, 1065], [2010, 2065]]);
});

test('a strobe model that is taken away leaves the line at rest', () => {
  const machine = withCam([1000, 2000]);
  machine.setStrobe({ delay: 10, width: 5000 });
  machine.run(1500);
  assert.equal(machine.wires.levels[STROBE], 1);
  machine.setStrobe(null);
  machine.run(10_000);
  assert.deepEqual(pulses(machine, STROBE).length, 1);
  assert.equal(machine.wires.levels[STROBE], 0);
});

test('vsync has its period, without those that are missing, and with second ones', () => {
  const machine = sleepingMachine();
  machine.setVsync({ first: 1000, period: 400, width: 20, missing: [1], double: [2] });
  machine.run(2300);
  assert.deepEqual(pulses(machine, SYNC), [[1000, 1020], [1800, 1820], [1900, 1920], [2200, 2220]]);
});

test('the jitter of vsync stays within its bound, fills it, and comes from the seed', () => {
  const rises = (seed) => {
    const machine = sleepingMachine();
    machine.setVsync({ first: 1000, period: 1000, width: 10, jitter: 30, seed });
    machine.run(1_000_500);
    return pulses(machine, SYNC).map(([rise], index) => rise - 1000 * (index + 1));
  };
  const offsets = rises(1);
  assert.equal(offsets.length, 1000);
  assert.equal(Math.max(...offsets), 30);
  assert.equal(Math.min(...offsets), -30);
  assert.deepEqual(rises(1), offsets);
  assert.notDeepEqual(rises(2), offsets);
});

test('an input changes in the cycle that it is told', () => {
  const machine = sleepingMachine();
  machine.drive(SYNC, 1, 500);
  machine.drive(SYNC, 0, 501);
  machine.run(489);
  machine.drive(STROBE, 1);
  machine.run(1000);
  assert.deepEqual(machine.edges, [500, SYNC, 1, 500, STROBE, 1, 501, SYNC, 0]);
});
