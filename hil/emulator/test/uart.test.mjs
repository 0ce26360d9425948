import assert from 'node:assert/strict';
import { test } from 'node:test';
import { mend, sleepingMachine } from '../rig/rigs.mjs';

const UART = 0x40034000;
const DR = UART;
const FR = UART + 0x18;
const RIS = UART + 0x3c;
const TXFF = 1 << 5;
const [RX, TX, TIMEOUT, OVERRUN] = [1 << 4, 1 << 5, 1 << 6, 1 << 10];
/** A bit is 16 cycles, so a character is 160. */
const CHARACTER = 160;

function enable(mcu) {
  mcu.writeUint32(UART + 0x24, 1);
  mcu.writeUint32(UART + 0x28, 0);
  mcu.writeUint32(UART + 0x2c, 0x70);
  mcu.writeUint32(UART + 0x30, 0x301);
}

mend(
  'a byte takes the time of its bits',
  ({ mcu, pass }) => {
    enable(mcu);
    const sent = [];
    mcu.uart[0].onByte = (byte) => sent.push(byte);
    mcu.writeUint32(DR, 0x55);
    pass(CHARACTER - 1);
    const before = sent.length;
    pass(1);
    return [before, sent.length];
  },
  { stock: [1, 1], right: [0, 1] },
);

mend(
  'the transmit FIFO can be full',
  ({ mcu }) => {
    enable(mcu);
    for (let i = 0; i < 33; i++) mcu.writeUint32(DR, i);
    return !!(mcu.readUint32(FR) & TXFF);
  },
  { stock: false, right: true },
);

mend(
  'the transmit interrupt comes when the FIFO falls to its level, not before anything was sent',
  ({ mcu, pass }) => {
    enable(mcu);
    mcu.writeUint32(UART + 0x38, TX);
    const before = mcu.readUint32(RIS) & TX;
    for (let i = 0; i < 18; i++) mcu.writeUint32(DR, i);
    // One is in the shift register; at the end of the first there are 16 in the FIFO.
    pass(CHARACTER - 1);
    const full = mcu.readUint32(RIS) & TX;
    pass(1);
    return [before, full, mcu.readUint32(RIS) & TX];
  },
  { stock: [TX, TX, TX], right: [0, 0, TX] },
);

mend(
  'the receive interrupt comes at the FIFO’s level, or after a pause of 32 bits',
  ({ mcu, pass, receive }) => {
    enable(mcu);
    receive(1);
    const first = mcu.readUint32(RIS) & (RX | TIMEOUT);
    pass(32 * 16);
    return [first, mcu.readUint32(RIS) & (RX | TIMEOUT)];
  },
  { stock: [RX, RX], right: [0, TIMEOUT] },
);

mend(
  'a byte that finds the FIFO full is lost, and that is told',
  ({ mcu, receive }) => {
    enable(mcu);
    for (let i = 0; i < 33; i++) receive(i);
    return !!(mcu.readUint32(RIS) & OVERRUN);
  },
  { stock: false, right: true },
);

test('bytes of the host come at the baud rate of the device, one after the other', () => {
  const machine = sleepingMachine();
  enable(machine.chip.mcu);
  const arrived = [];
  machine.chip.uart.receive = () => arrived.push(machine.cycle);
  const last = machine.send([1, 2, 3], 1000);
  machine.send([4], 0);
  machine.run(2000);
  assert.deepEqual(arrived, [1160, 1320, 1480, 1640]);
  assert.equal(last, 1480);
});
