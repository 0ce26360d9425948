import assert from 'node:assert/strict';
import { test } from 'node:test';
import { mend, sleepingMachine } from '../rig/rigs.mjs';

const PAD5 = 0x4001c000 + 4 + 4 * 5;
const PULLED_UP = 0x5a;
const GPIO_IN = 0xd0000004;

mend('pads begin with their inputs on', ({ mcu }) => mcu.readUint32(PAD5), { stock: 0x36, right: 0x56 });

mend(
  'an input that nobody drives follows its pull',
  ({ mcu }) => {
    mcu.writeUint32(PAD5, PULLED_UP);
    return (mcu.readUint32(GPIO_IN) >>> 5) & 1;
  },
  { stock: 0, right: 1 },
);

mend(
  'an input sees what its own pin puts out',
  ({ mcu }) => {
    mcu.writeUint32(0x4001402c, 5);
    mcu.writeUint32(0xd0000024, 1 << 5);
    mcu.writeUint32(PAD5, 0x56);
    mcu.writeUint32(0xd0000014, 1 << 5);
    return (mcu.readUint32(GPIO_IN) >>> 5) & 1;
  },
  { stock: 0, right: 1 },
);

test('who drives a wire has the last word, and its pull the first', () => {
  const machine = sleepingMachine();
  const { mcu } = machine.chip;
  const levels = [];
  const note = () => levels.push(machine.wires.levels[5]);
  mcu.writeUint32(PAD5, PULLED_UP);
  note();
  machine.wires.drive(5, 0);
  note();
  mcu.writeUint32(0x4001402c, 5);
  mcu.writeUint32(0xd0000014, 1 << 5);
  mcu.writeUint32(0xd0000024, 1 << 5);
  note();
  assert.deepEqual(levels, [1, 0, 1]);
});
