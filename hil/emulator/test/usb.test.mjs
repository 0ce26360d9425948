import { mend } from '../rig/rigs.mjs';

const DPRAM = 0x50100000;
const EP1_OUT_CONTROL = DPRAM + 0x0c;
const EP1_OUT_BUFFER = DPRAM + 0x8c;
const SIE_STATUS = 0x50110050;
const AVAILABLE = 1 << 10;
const SUSPENDED = 1 << 4;

mend(
  'an OUT buffer that is armed stays armed until a packet has come',
  ({ mcu, pass }) => {
    mcu.writeUint32(EP1_OUT_CONTROL, 0xa0000180);
    mcu.writeUint32(EP1_OUT_BUFFER, 64 | AVAILABLE);
    pass(10_000);
    return mcu.readUint32(EP1_OUT_BUFFER) & AVAILABLE;
  },
  { stock: 0, right: AVAILABLE },
);

mend(
  'SUSPENDED can be cleared',
  ({ mcu }) => {
    mcu.usbCtrl.sieStatus |= SUSPENDED;
    mcu.writeUint32(SIE_STATUS, SUSPENDED);
    return mcu.readUint32(SIE_STATUS) & SUSPENDED;
  },
  { stock: SUSPENDED, right: 0 },
);
