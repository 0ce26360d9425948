import assert from 'node:assert/strict';
import { test } from 'node:test';
import { CycleClock } from '../chip/clock.mjs';
import { Machine } from '../machine.mjs';
import { imageOf, sleepingMachine } from '../rig/rigs.mjs';

const CLK_SYS_CTRL = 0x4000803c;
const CLK_PERI_CTRL = 0x40008048;
const PLL_SYS = 0x40028000;
const TIMERAWL = 0x40054028;

function clockAt(hz) {
  const time = { cycle: 0, expect() {} };
  const clock = new CycleClock(time);
  clock.setRate(hz);
  const fired = [];
  const alarm = (name) => clock.createAlarm(() => fired.push([name, time.cycle]));
  const pass = (end) => {
    while (clock.next <= end) {
      time.cycle = clock.next;
      clock.fire();
    }
    time.cycle = end;
  };
  return { clock, fired, alarm, pass };
}

test('an alarm comes in the first cycle that is not before its time, in the order in which it was set', () => {
  const { clock, fired, alarm, pass } = clockAt(125e6);
  alarm('b').schedule(17);
  alarm('a').schedule(16);
  alarm('c').scheduleCycles(3);
  const cancelled = alarm('never');
  cancelled.schedule(8);
  cancelled.cancel();
  pass(10);
  assert.deepEqual(fired, [['a', 2], ['b', 3], ['c', 3]]);
  assert.equal(clock.nanos, 80);
});

test('a change of the rate keeps the time of an alarm and moves its cycle', () => {
  const { clock, fired, alarm, pass } = clockAt(100e6);
  alarm('a').schedule(1000);
  pass(50);
  clock.setRate(200e6);
  pass(1000);
  assert.deepEqual(fired, [['a', 150]]);
});

test('timer and clocks follow the PLL', () => {
  const machine = sleepingMachine();
  const { mcu } = machine.chip;
  for (const [feedback, hz] of [
    [125, 250e6],
    [100, 200e6],
  ]) {
    mcu.writeUint32(PLL_SYS, 1);
    mcu.writeUint32(PLL_SYS + 8, feedback);
    mcu.writeUint32(PLL_SYS + 12, (3 << 16) | (2 << 12));
    mcu.writeUint32(CLK_SYS_CTRL, 1);
    mcu.writeUint32(CLK_PERI_CTRL, 1 << 11);
    assert.deepEqual([mcu.clkSys, mcu.clkPeri], [hz, hz]);
    const before = mcu.readUint32(TIMERAWL);
    machine.run(hz / 1e6 * 700);
    assert.equal(mcu.readUint32(TIMERAWL) - before, 700);
  }
});

test('the chip begins with its ring oscillator', () => {
  assert.equal(new Machine(imageOf([0xbf30])).chip.mcu.clkSys, 6.5e6);
});
