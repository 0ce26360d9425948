// What happens outside of the chip, by cycle: input edges, bytes on the UART line. It outlives a reset.

export class World {
  /** `expect` is told of the cycle of an event that is new. */
  constructor(expect) {
    this.expect = expect;
    /** The cycle of the next event. */
    this.next = Infinity;
    this.events = [];
  }

  /** Lets `action` happen at `cycle`; those of one cycle happen in the order in which they were asked for. */
  at(cycle, action) {
    let index = this.events.length;
    while (index > 0 && this.events[index - 1].cycle > cycle) index--;
    const event = { cycle, action };
    this.events.splice(index, 0, event);
    this.next = this.events[0].cycle;
    this.expect(this.next);
    return event;
  }

  cancel(event) {
    const index = this.events.indexOf(event);
    if (index >= 0) this.events.splice(index, 1);
    this.next = this.events.length ? this.events[0].cycle : Infinity;
  }

  /** Lets all happen that is due at `cycle`. */
  fire(cycle) {
    while (this.next <= cycle) {
      const { action } = this.events.shift();
      this.next = this.events.length ? this.events[0].cycle : Infinity;
      action();
    }
  }
}
