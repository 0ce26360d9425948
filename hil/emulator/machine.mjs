// The machine: a chip, what is wired to it, and the time that passes for both.
//
// # Design
// Cycle c of clk_sys is played in this order: alarms of the chip (timer, UART, USB, DMA), events of the world
// (input edges), then the tick of the PIO. An instruction of the CPU acts after the cycle in which it begins,
// and the next one begins as many cycles later as it takes. A cycle in which nothing of this is due is passed over:
// the PIO tells until when it can be (pio.mjs), and `lazy: false` plays every cycle, for comparison.
import { Chip } from './chip/chip.mjs';
import { Strobe, Vsync } from './lines/models.mjs';
import { Wires } from './lines/wires.mjs';
import { World } from './lines/world.mjs';
import { UartLine } from './link/uart-line.mjs';
import { UsbHost } from './link/usb-host.mjs';
import { randomFrom } from './random.mjs';

/** The watchdog's reason where software has forced the reset. */
const FORCED = 2;

export const LINES = { proj: 2, cam: 3, sync: 4, strobe: 5, auxA: 6, auxB: 7, photo: 8, start: 9, led: 25 };
const PINS = 30;
/** Lines that the box listens to. */
export const INPUTS = new Set([LINES.sync, LINES.strobe, LINES.photo, LINES.start]);
export const OUTPUTS = new Set([LINES.proj, LINES.cam, LINES.auxA, LINES.auxB]);
const WATCHED = new Set([...OUTPUTS, ...INPUTS]);
/** Cycles of the input synchroniser: two flip-flops. */
const SYNC_CYCLES = 2;
const UART_RX = 1;
/** A UART input that floats takes up a character now and then. */
const NOISE_CYCLES = 100_000;

/** The parts of a cycle, see above; in the last one the CPU begins an instruction. */
const Phase = { events: 0, tick: 1, over: 2 };

export class Machine {
  /** A machine with `image` in its flash, spoken to over `link` ("uart" or "usb"). */
  constructor(image, { link = 'uart', lazy = true, flashCache = false, inputSync = false, uniqueId } = {}) {
    this.image = image;
    this.link = link;
    this.options = { lazy, flashCache, uniqueId };
    /** The cycle that is now: all up to it have been played. */
    this.cycle = 0;
    /** Which part of the cycle it is. */
    this.phase = Phase.over;
    /** Nothing is due before this cycle; something may be in it. */
    this.due = 0;
    /** The cycle at which the CPU begins its next instruction. */
    this.cpuFree = 0;
    /** Cycles in which the CPU has worked. */
    this.busy = 0;
    this.overruns = 0;
    /** For how many cycles interrupts were masked at most, and since when they are. */
    this.longestMasked = 0;
    this.maskedSince = -1;
    /** Reads of flash, and misses, of the chips before this one. */
    this.flash = { reads: 0, misses: 0 };
    /** What the ring oscillator's random bit is drawn from; it goes on over resets. */
    this.random = randomFrom(0);
    this.warnings = new Map();
    this.warn = (component, text) => {
      const warning = `${component}: ${text}`;
      this.warnings.set(warning, (this.warnings.get(warning) ?? 0) + 1);
    };
    this.received = [];
    this.edges = [];
    this.until = new Set();
    this.why = null;
    this.resetRequested = false;
    this.inBootLoader = false;
    this.plugged = true;
    this.world = new World((cycle) => this.expect(cycle));
    this.wires = new Wires(PINS, WATCHED, (pin, level) => this.edge(pin, level));
    if (inputSync) this.wires.later = (action) => this.world.at(this.stamp + SYNC_CYCLES, action);
    /** Outputs with a wire to an input. */
    this.jumpers = new Map();
    this.strobe = null;
    this.vsync = null;
    this.profile = null;
    this.startChip();
    this.chip.load(image);
    this.chip.boot();
    this.edges.length = 0;
    this.uartLine = new UartLine(this);
    if (link !== 'uart') this.leaveOpen();
  }

  /** Nobody is at the UART: its input is at rest only where it is pulled there. */
  leaveOpen() {
    const noise = randomFrom(1);
    const hear = () => {
      const { mcu, uart } = this.chip;
      if (!mcu.gpio[UART_RX].pullupEnabled) uart.receive(Math.floor(noise() * 256));
      this.world.at(this.cycle + NOISE_CYCLES, hear);
    };
    this.world.at(this.cycle + NOISE_CYCLES, hear);
  }

  startChip({ powerWasOff } = {}) {
    const before = this.chip;
    if (before) {
      this.overruns += before.uart.overruns;
      const { reads, misses } = this.flashReads;
      this.flash = { reads, misses };
    }
    this.chip = new Chip(this, this.wires, before, { ...this.options, powerWasOff });
    this.wires.connect(this.chip.mcu);
    this.chip.mcu.onBreak = (code) => this.halt(`BKPT ${code}`);
    this.chip.mcu.onLockup = (address) => this.halt(`lockup at 0x${address.toString(16)}`);
    this.usb = new UsbHost(this.chip.mcu.usbCtrl, this.chip.clock, (bytes) => {
      if (this.link === 'usb') this.receive(bytes);
    });
    this.usb.plugged = this.plugged;
    this.chip.uart.onByte = (byte) => {
      if (this.link === 'uart') this.receive([byte]);
    };
  }

  get core() {
    return this.chip.mcu.core;
  }

  /** Reads of flash by the CPU, and how many of them missed the cache. */
  get flashReads() {
    const { cache } = this.core;
    return {
      reads: this.flash.reads + (cache?.reads ?? 0),
      misses: this.flash.misses + (cache?.misses ?? 0),
    };
  }

  /** The cycle up to which the PIO has been played, or has to be before anything touches it. */
  get ticked() {
    return this.phase === Phase.events ? this.cycle - 1 : this.cycle;
  }

  /** The cycle from which a change that is made now is seen. */
  get stamp() {
    return this.phase === Phase.over ? this.cycle + 1 : this.cycle;
  }

  /** Something is due in `cycle`. */
  expect(cycle) {
    if (cycle < this.due) this.due = cycle;
  }

  /** Lets up to `cycles` pass; less when something of `until` comes, a reset or a halt. Says why it ended. */
  run(cycles, until = []) {
    const end = this.cycle + cycles;
    this.until = new Set(until);
    this.why = null;
    if (this.resetRequested) this.reset();
    while (this.cycle < end && this.why === null) {
      const { core } = this.chip.mcu;
      if (core.waiting) {
        this.pass(Math.min(end, this.nextEvent()));
        this.cpuFree = this.cycle;
        continue;
      }
      if (this.cpuFree <= this.cycle) this.execute(core);
      const target = Math.min(end, this.cpuFree);
      if (target < this.due) this.cycle = target;
      else this.pass(target);
    }
    return this.why ?? 'cycles';
  }

  /** Lets the CPU begin its next instruction. */
  execute(core) {
    const address = core.registers[15];
    const spent = core.executeInstruction();
    if (core.PM !== this.maskedSince >= 0) this.masked(core.PM);
    if (this.profile !== null) this.profile.count(address, spent);
    this.busy += spent;
    this.cpuFree = this.cycle + spent;
    if (this.resetRequested) this.reset();
  }

  /** Interrupts are masked from now on, or no longer. */
  masked(masked) {
    if (!masked) this.longestMasked = Math.max(this.longestMasked, this.cycle - this.maskedSince);
    this.maskedSince = masked ? this.cycle : -1;
  }

  /** The next cycle in which something is due. */
  nextEvent() {
    const [pio0, pio1] = this.chip.mcu.pio;
    return Math.min(this.chip.clock.next, this.world.next, pio0.quiet + 1, pio1.quiet + 1);
  }

  /** Lets time pass until the end of cycle `end`. */
  pass(end) {
    for (;;) {
      this.due = this.nextEvent();
      if (this.due > end) break;
      this.play(Math.max(this.due, this.ticked + 1));
      if (this.why !== null) return;
    }
    this.cycle = end;
  }

  /** Plays `cycle`, in which something is due; none before it is. */
  play(cycle) {
    const { clock, mcu } = this.chip;
    this.cycle = cycle;
    this.phase = Phase.events;
    clock.fire();
    this.world.fire(cycle);
    for (const pio of mcu.pio) if (pio.quiet < cycle) pio.catchUp();
    this.phase = Phase.tick;
    for (const pio of mcu.pio) if (pio.quiet < cycle) pio.tick();
    for (const pio of mcu.pio) pio.reportPins();
    this.phase = Phase.over;
    if (this.resetRequested) this.reset();
  }

  requestReset() {
    this.resetRequested = true;
  }

  /** The firmware leaves for the boot loader. */
  requestBootLoader() {
    this.inBootLoader = true;
    this.resetRequested = true;
  }

  /** The boot loader writes `image` to flash and starts it, with the watchdog's help. */
  take(image) {
    this.image = image;
    this.chip.load(image);
    this.chip.watchdog.reason = FORCED;
    this.inBootLoader = false;
    this.reset();
  }

  /** The power goes off and comes back. */
  power() {
    this.inBootLoader = false;
    this.reset({ powerWasOff: true });
  }

  reset({ powerWasOff = false } = {}) {
    this.resetRequested = false;
    this.startChip({ powerWasOff });
    this.chip.boot();
    // The boot loader is not played: the CPU waits for what does not come.
    this.core.waiting = this.inBootLoader;
    this.cpuFree = this.cycle;
    this.why = this.inBootLoader ? 'boot' : 'reset';
  }

  halt(reason) {
    this.warn('CPU', reason);
    this.why = 'halt';
  }

  /** The chip's outputs in the bits of `pins` have changed. */
  outputsChanged(pins) {
    for (let pin = 0; pin < PINS; pin++) if (pins & (1 << pin)) this.wires.update(pin);
  }

  edge(pin, level) {
    // An input that nobody drives has no edges to tell: its level is the chip's own pull.
    if (!OUTPUTS.has(pin) && this.wires.outside[pin] < 0) return;
    this.edges.push(this.stamp, pin, level);
    if (pin === LINES.cam) this.strobe?.camEdge(this.stamp, level);
    if (this.jumpers.has(pin)) this.drive(this.jumpers.get(pin), level, this.stamp + 1);
    if (OUTPUTS.has(pin) && this.until.has('edge')) this.why ??= 'edge';
  }

  receive(bytes) {
    for (const byte of bytes) {
      this.received.push(byte);
      if (byte === 0 && this.until.has('frame')) this.why ??= 'frame';
    }
  }

  /** Sends `bytes` to the chip, from `cycle` on. Returns when the last one arrives, if that is known. */
  send(bytes, cycle = this.cycle) {
    if (this.link === 'uart') return this.uartLine.send(bytes, Math.max(cycle, this.cycle));
    if (cycle > this.cycle) this.world.at(cycle, () => this.usb.send(bytes));
    else this.usb.send(bytes);
    return undefined;
  }

  drive(pin, level, cycle = this.stamp) {
    this.world.at(Math.max(cycle, this.stamp), () => this.wires.drive(pin, level));
  }

  /** A wire from an output to an input, which has its level from the next cycle on. */
  jumper(from, to) {
    this.jumpers.set(from, to);
    this.drive(to, this.wires.levels[from]);
  }

  setStrobe(parameters) {
    this.strobe?.stop();
    this.strobe = parameters && new Strobe(this, LINES.strobe, parameters);
  }

  setVsync(parameters) {
    this.vsync?.stop();
    this.vsync = parameters && new Vsync(this, LINES.sync, parameters);
  }

  plug(plugged) {
    this.plugged = plugged;
    this.usb.plug(plugged);
  }

  /** Lets the USB controller hang until the chip is reset. */
  wedge() {
    this.usb.wedge();
  }

  /** The USB host goes to sleep, or wakes. */
  doze(on) {
    this.usb.doze(on);
  }

  /** Whether the USB host asks for packets. */
  fetch(fetching) {
    this.usb.fetch(fetching);
  }

  /** Lets the CPU go on at `address`. */
  jump(address, r0, primask) {
    const { core } = this;
    core.PC = (address & ~1) >>> 0;
    if (r0 !== undefined) core.registers[0] = r0;
    if (primask !== undefined) {
      core.PM = primask === 1;
      core.interruptsUpdated = true;
    }
    core.waiting = false;
    this.cpuFree = this.cycle;
  }
}
