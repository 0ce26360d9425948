// The parts of rp2040js that its package entry does not export, in one place.
// rp2040js is pinned to one exact version because of these paths.
const root = './node_modules/rp2040js/dist/esm';
export { FIFO, BasePeripheral, RP2040, RPPIO, RPUSBController, USBCDC } from 'rp2040js';
export const { CortexM0Core } = await import(`${root}/cortex-m0-core.js`);
export const { RPPPB } = await import(`${root}/peripherals/ppb.js`);
export const { RPDMAChannel, DREQChannel } = await import(`${root}/peripherals/dma.js`);
export const { RPUART } = await import(`${root}/peripherals/uart.js`);
export const { SimulationClock } = await import(`${root}/clock/simulation-clock.js`);
export const { IRQ } = await import(`${root}/irq.js`);
