import assert from 'node:assert/strict';
import { test } from 'node:test';
import { mend, sleepingMachine } from '../rig/rigs.mjs';

const GPIO5_CTRL = 0x40014000 + 8 * 5 + 4;
const SIO_FUNCTION = 5;
const NO_FUNCTION = 0x1f;
const WATCHDOG = 0x40058000;
const AIRCR = 0xe000ed0c;
const RESETS = 0x4000c000;
const PIO0 = 1 << 10;
const PIO0_SHIFTCTRL = 0x502000d0;
const RANDOMBIT = 0x4006001c;

/** The function of a pin before and after `act` and some time. */
const functionAfter = (act, cycles) => (rig) => {
  rig.mcu.writeUint32(GPIO5_CTRL, SIO_FUNCTION);
  act(rig.mcu);
  rig.pass(cycles);
  return rig.mcu.readUint32(GPIO5_CTRL) & 0x1f;
};
const afterReset = { stock: SIO_FUNCTION, right: NO_FUNCTION };

mend(
  'SYSRESETREQ resets the chip',
  functionAfter((mcu) => mcu.writeUint32(AIRCR, 0x05fa0004), 10),
  afterReset,
);

mend(
  'the watchdog can be told to reset the chip',
  functionAfter((mcu) => mcu.writeUint32(WATCHDOG, 0x80000000), 10),
  afterReset,
);

mend(
  'the watchdog bites, after half the microseconds that it was loaded with',
  (rig) => {
    const bite = functionAfter((mcu) => {
      mcu.writeUint32(WATCHDOG + 4, 200);
      mcu.writeUint32(WATCHDOG, 0x40000000);
    }, 99 * 125)(rig);
    rig.pass(2 * 125);
    return [bite, rig.mcu.readUint32(GPIO5_CTRL) & 0x1f];
  },
  { stock: [SIO_FUNCTION, SIO_FUNCTION], right: [SIO_FUNCTION, NO_FUNCTION] },
);

mend(
  'RESETS holds a peripheral in its reset state',
  ({ mcu }) => {
    mcu.writeUint32(PIO0_SHIFTCTRL, 0);
    mcu.writeUint32(RESETS, PIO0);
    const done = mcu.readUint32(RESETS + 8) & PIO0;
    mcu.writeUint32(RESETS, 0);
    return [done, mcu.readUint32(PIO0_SHIFTCTRL), mcu.readUint32(RESETS + 8) & PIO0];
  },
  { stock: [PIO0, 0, PIO0], right: [0, 0xc0000, PIO0] },
);

mend(
  'the random bit is random',
  ({ mcu }) => new Set(Array.from({ length: 100 }, () => mcu.readUint32(RANDOMBIT) & 1)).size,
  { stock: 1, right: 2 },
);

test('memory, scratch registers, the wires and the reason outlive a reset', () => {
  const machine = sleepingMachine();
  const scratch0 = WATCHDOG + 0x0c;
  machine.chip.mcu.writeUint32(0x20001000, 0x1234);
  machine.chip.mcu.writeUint32(scratch0, 0x5678);
  machine.drive(4, 1);
  machine.run(10);
  const { cycle } = machine;
  machine.chip.mcu.writeUint32(WATCHDOG, 0x80000000);
  assert.equal(machine.run(10), 'reset');
  const { mcu } = machine.chip;
  assert.deepEqual(
    [mcu.readUint32(0x20001000), mcu.readUint32(scratch0), mcu.readUint32(WATCHDOG + 8), machine.wires.levels[4]],
    [0x1234, 0x5678, 2, 1],
  );
  assert.ok(machine.cycle >= cycle, 'cycles never go back');
  assert.equal(mcu.clkSys, 6.5e6, 'and the clocks are those after a reset');
});
