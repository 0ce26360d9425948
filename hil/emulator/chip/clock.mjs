// Time of the chip, counted in cycles of clk_sys.
//
// # Design
// rp2040js asks its clock for nanoseconds since the chip's reset and for alarms in nanoseconds. What is exact
// here is the cycle: nanoseconds follow from it and from the rate of clk_sys, and each alarm is due at the
// first cycle that is not before its time. A change of the rate moves the alarms to their new cycles. Alarms
// that are due in the same cycle are called in the order in which they were set.
//
// The stock clock moves time by whatever it is told, in floating-point nanoseconds, and knows no cycles.

/** Absorbs the rounding of nanoseconds that are not whole. In cycles. */
const ROUNDING = 1e-4;

class Alarm {
  constructor(clock, callback) {
    this.clock = clock;
    this.callback = callback;
    this.nanos = 0;
    this.cycle = Infinity;
  }

  get scheduled() {
    return this.cycle !== Infinity;
  }

  /** To be called `deltaNanos` from now. Replaces what was set before. */
  schedule(deltaNanos) {
    this.clock.insert(this, this.clock.nanos + deltaNanos);
  }

  /** To be called `cycles` from now, exactly. */
  scheduleCycles(cycles) {
    this.schedule(cycles * this.clock.nanosPerCycle);
  }

  cancel() {
    this.clock.remove(this);
  }
}

export class CycleClock {
  /** A clock that reads `time.cycle` and tells `time.expect` when its next alarm is due; no time has passed. */
  constructor(time) {
    this.time = time;
    /** The cycle at which the next alarm is due. */
    this.next = Infinity;
    this.alarms = [];
    this.baseCycle = time.cycle;
    this.baseNanos = 0;
    this.nanosPerCycle = 1;
  }

  /** The cycle that is now. */
  get cycle() {
    return this.time.cycle;
  }

  get nanos() {
    return this.baseNanos + (this.cycle - this.baseCycle) * this.nanosPerCycle;
  }

  get micros() {
    return this.nanos / 1000;
  }

  createAlarm(callback) {
    return new Alarm(this, callback);
  }

  /** From now on a second has `hz` cycles. */
  setRate(hz) {
    this.baseNanos = this.nanos;
    this.baseCycle = this.cycle;
    this.nanosPerCycle = 1e9 / hz;
    for (const alarm of this.alarms) alarm.cycle = this.cycleAt(alarm.nanos);
    this.next = this.alarms.length ? this.alarms[0].cycle : Infinity;
    this.time.expect(this.next);
  }

  /** Calls all alarms that are due by now. */
  fire() {
    while (this.next <= this.cycle) {
      const alarm = this.alarms.shift();
      alarm.cycle = Infinity;
      this.next = this.alarms.length ? this.alarms[0].cycle : Infinity;
      alarm.callback();
    }
  }

  cycleAt(nanos) {
    return this.baseCycle + Math.ceil((nanos - this.baseNanos) / this.nanosPerCycle - ROUNDING);
  }

  insert(alarm, nanos) {
    this.remove(alarm);
    alarm.nanos = nanos;
    alarm.cycle = this.cycleAt(nanos);
    let at = this.alarms.length;
    while (at > 0 && this.alarms[at - 1].cycle > alarm.cycle) at--;
    this.alarms.splice(at, 0, alarm);
    this.next = this.alarms[0].cycle;
    this.time.expect(this.next);
  }

  remove(alarm) {
    if (!alarm.scheduled) return;
    alarm.cycle = Infinity;
    this.alarms.splice(this.alarms.indexOf(alarm), 1);
    this.next = this.alarms.length ? this.alarms[0].cycle : Infinity;
  }
}
