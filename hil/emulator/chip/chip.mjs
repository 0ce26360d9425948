// One RP2040 from a reset to the next: the stock chip with its mends put in.
//
// # Design
// A reset builds a new chip, so that nothing can be forgotten; memories, watchdog scratch registers and the
// reason of the reset go over to it. The boot ROM is not played: code begins at the vector table behind the
// second-stage boot loader, at the rate of the ring oscillator.
import { IRQ, RP2040 } from '../stock.mjs';
import { CycleClock } from './clock.mjs';
import { bootRom } from './boot-rom.mjs';
import { Cpu } from './cpu.mjs';
import { FlashCache } from './flash-cache.mjs';
import { paceDma, resetDma } from './dma.mjs';
import { Pad } from '../lines/wires.mjs';
import { Pio } from './pio.mjs';
import { Ppb } from './ppb.mjs';
import { Registers, Resets, Rosc, VREG_AND_CHIP_RESET, XIP } from './registers.mjs';
import { Ssi } from './ssi.mjs';
import { Uart } from './uart.mjs';
import { UsbDevice } from './usb-device.mjs';

const VECTORS = 0x10000100;
const SSI = 0x18000;
const XIP_CTRL = 0x14000;
/** The number of a flash that was given none. */
const UNIQUE_ID = [0xe6, 0x61, 0xa4, 0xd4, 0x17, 0x70, 0xa0, 0x01];
const UART0 = 0x40034;
const UART1 = 0x40038;
const RESETS = 0x4000c;
const WATCHDOG = 0x40058;
const ROSC = 0x40060;
const VREG = 0x40064;
const USB = 0x50110;
const PIO = [0x50200, 0x50300];

export class Chip {
  /**
   * `time` is the machine: `cycle`, `ticked`, `expect`, `outputsChanged`, `requestReset`, `random`, `warn`.
   * `before` is the chip whose memories this one goes on with, if it is not the first: only the flash if the power was off.
   */
  constructor(time, wires, before, options) {
    const clock = new CycleClock(time);
    const mcu = new RP2040(clock);
    this.clock = clock;
    this.mcu = mcu;
    mcu.logger = { debug() {}, info() {}, warn: time.warn, error: time.warn };
    mcu.clkSys = mcu.roscFreq;
    mcu.clkPeri = mcu.roscFreq;
    clock.setRate(mcu.clkSys);
    mcu.addClockListener((hz) => clock.setRate(hz));
    if (before) this.takeOver(before.mcu, options.powerWasOff);

    mcu.core = new Cpu(mcu);
    if (options.flashCache) mcu.core.cache = new FlashCache();
    mcu.ppb = new Ppb(mcu, 'PPB', () => time.requestReset());
    mcu.gpio = mcu.gpio.map((_, index) => new Pad(mcu, index, wires));
    paceDma(mcu.dma);
    mcu.pio = PIO.map((address, index) => {
      const firstIrq = index ? IRQ.PIO1_IRQ0 : IRQ.PIO0_IRQ0;
      const pio = new Pio(mcu, `PIO${index}`, firstIrq, index, time, options);
      mcu.peripherals[address] = pio;
      return pio;
    });
    mcu.peripherals[SSI] = new Ssi(mcu, 'SSI', options.uniqueId ?? UNIQUE_ID);
    mcu.peripherals[SSI].onBootLoader = () => time.requestBootLoader();
    mcu.bootrom.set(bootRom());
    mcu.uart = mcu.uart.map((stock) => new Uart(mcu, stock.name, stock.irq, stock.dreq));
    mcu.peripherals[UART0] = mcu.uart[0];
    mcu.peripherals[UART1] = mcu.uart[1];
    mcu.peripherals[ROSC] = new Rosc(mcu, 'ROSC', time.random);
    mcu.peripherals[XIP_CTRL] = new Registers(mcu, 'XIP_CTRL', XIP);
    mcu.peripherals[VREG] = new Registers(mcu, 'VREG_AND_CHIP_RESET', VREG_AND_CHIP_RESET);
    mcu.peripherals[RESETS] = new Resets(mcu, 'RESETS', {
      2: () => resetDma(mcu.dma),
      5: () => mcu.gpio.forEach((pad) => pad.resetControl()),
      8: () => mcu.gpio.forEach((pad) => pad.resetPad()),
      10: () => mcu.pio[0].reset(),
      11: () => mcu.pio[1].reset(),
      22: () => mcu.uart[0].reset(),
      23: () => mcu.uart[1].reset(),
    });
    mcu.usbCtrl = new UsbDevice(mcu, 'USB');
    mcu.peripherals[USB] = mcu.usbCtrl;
    this.watchdog.onWatchdogTrigger = () => {
      // Stock's alarm would go off again, and again, in the same instant.
      this.watchdog.alarm.enable = false;
      time.requestReset();
    };
  }

  get uart() {
    return this.mcu.uart[0];
  }

  get watchdog() {
    return this.mcu.peripherals[WATCHDOG];
  }

  /** Goes on with the memories of `mcu`, and with what its watchdog keeps, or, if the power was off, with the flash alone. */
  takeOver(mcu, powerWasOff) {
    for (const memory of ['flash', 'flash16', 'flashView']) this.mcu[memory] = mcu[memory];
    if (powerWasOff) return;
    for (const memory of ['sram', 'sramView']) this.mcu[memory] = mcu[memory];
    const old = mcu.peripherals[WATCHDOG];
    this.watchdog.reason = old.reason;
    this.watchdog.scratchData.set(old.scratchData);
  }

  load({ segments }) {
    for (const { address, bytes } of segments) this.mcu.flash.set(bytes, address & 0xffffff);
  }

  boot() {
    const { core } = this.mcu;
    core.VTOR = VECTORS;
    core.reset();
  }
}
