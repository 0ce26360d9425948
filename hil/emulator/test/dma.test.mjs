import { RAM, mend } from '../rig/rigs.mjs';

const CHANNEL0 = 0x50000000;
const TRANS_COUNT = CHANNEL0 + 0x08;
const WORDS_INCREASING_ALWAYS = 1 | (2 << 2) | (1 << 4) | (1 << 5) | (63 << 15);

mend(
  'a transfer takes a cycle',
  ({ mcu, pass }) => {
    mcu.writeUint32(CHANNEL0, RAM);
    mcu.writeUint32(CHANNEL0 + 4, RAM + 0x1000);
    mcu.writeUint32(TRANS_COUNT, 100);
    mcu.writeUint32(CHANNEL0 + 0x0c, WORDS_INCREASING_ALWAYS);
    pass(10);
    const after10 = mcu.readUint32(TRANS_COUNT);
    pass(90);
    return [after10, mcu.readUint32(TRANS_COUNT)];
  },
  { stock: [0, 0], right: [90, 0] },
);
