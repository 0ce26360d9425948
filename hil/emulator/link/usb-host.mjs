// A USB host with one full-speed device: it enumerates it and moves bytes over its CDC-ACM interface.
//
// # Design
// A packet takes its share of a frame of 1 ms, into which 19 full ones fit, by its bytes and 13 of overhead; each
// direction has this pace by itself. A buffer that is not armed is asked for again as soon as it is. Bytes are
// there when their packet is through.
import {
  DataDirection,
  DescriptorType,
  SetupRecipient,
  SetupRequest,
  SetupType,
  createSetupPacket,
} from 'rp2040js';

const MS = 1e6;
const SOF_RD = 0x48;
const PACKET = 64;
const OVERHEAD_BYTES = 13;
const NANOS_PER_BYTE = MS / (19 * (PACKET + OVERHEAD_BYTES));
/** From the pull-up to the reset, and how long that lasts: shorter than a real host's 100 ms, and as long. */
const ATTACH_NANOS = 1 * MS;
const RESET_NANOS = 10 * MS;
const SUSPEND_NANOS = 3 * MS;

const CDC_DATA_CLASS = 10;
const BULK = 2;
const SET_LINE_CODING = 0x20;
const SET_CONTROL_LINE_STATE = 0x22;
const DTR_RTS = 3;
/** 115,200 baud, 8N1: what a terminal sets; it means nothing here. */
const LINE_CODING = Uint8Array.of(0x00, 0xc2, 0x01, 0x00, 0, 0, 8);

function standardIn(descriptor, length) {
  return {
    dataDirection: DataDirection.DeviceToHost,
    type: SetupType.Standard,
    recipient: SetupRecipient.Device,
    bRequest: SetupRequest.GetDescriptor,
    wValue: descriptor << 8,
    wIndex: 0,
    wLength: length,
  };
}

function standardOut(bRequest, wValue) {
  return {
    dataDirection: DataDirection.HostToDevice,
    type: SetupType.Standard,
    recipient: SetupRecipient.Device,
    bRequest,
    wValue,
    wIndex: 0,
    wLength: 0,
  };
}

function classOut(bRequest, wValue, data = new Uint8Array()) {
  return {
    dataDirection: DataDirection.HostToDevice,
    type: SetupType.Class,
    recipient: SetupRecipient.Interface,
    bRequest,
    wValue,
    wIndex: 0,
    wLength: data.length,
    data,
  };
}

/** The bulk endpoints of the CDC data interface in a configuration descriptor. */
function bulkEndpoints(descriptor) {
  const endpoints = { in: 0, out: 0 };
  let data = false;
  for (let at = 0; at + 1 < descriptor.length && descriptor[at] > 1; at += descriptor[at]) {
    const type = descriptor[at + 1];
    if (type === DescriptorType.Interface) data = descriptor[at + 5] === CDC_DATA_CLASS;
    if (!data || type !== DescriptorType.Endpoint || (descriptor[at + 3] & 3) !== BULK) continue;
    const address = descriptor[at + 2];
    endpoints[address & 0x80 ? 'in' : 'out'] = address & 0xf;
  }
  return endpoints;
}

export class UsbHost {
  /** `receive(bytes)` is called with what the device sends. */
  constructor(device, clock, receive) {
    this.device = device;
    this.clock = clock;
    this.receive = receive;
    this.plugged = true;
    /** Whether packets of the device are asked for: a program that does not read lets the system stop. */
    this.fetching = true;
    /** The frame that was the last before the bus fell silent or the controller got stuck, or −1 while all works. */
    this.stuckAt = -1;
    this.queue = [];
    this.forget();
    this.dozing = clock.createAlarm(() => device.suspend());
    this.bus = clock.createAlarm(() => this.busEvent());
    this.control = clock.createAlarm(() => this.controlPacket());
    this.bulkIn = { alarm: clock.createAlarm(() => this.takeBulk()), free: 0 };
    this.bulkOut = { alarm: clock.createAlarm(() => this.giveBulk()), free: 0 };
    device.host = this;
  }

  /** Bytes for the device. They wait until it takes them; unplugging loses them. */
  send(bytes) {
    for (const byte of bytes) this.queue.push(byte);
    this.pace(this.bulkOut, Math.min(this.queue.length, PACKET));
  }

  /** The controller hangs, as after an error on the bus: it takes nothing, gives nothing and counts no frame until a reset. */
  wedge() {
    this.stuckAt = this.device.readUint32(SOF_RD);
    for (const alarm of [this.bus, this.control, this.bulkIn.alarm, this.bulkOut.alarm]) alarm.cancel();
  }

  /** The host goes to sleep, as a computer does, and takes the bus with it; or it wakes. */
  doze(on) {
    if (on) {
      this.stuckAt = this.device.readUint32(SOF_RD);
      for (const alarm of [this.bulkIn.alarm, this.bulkOut.alarm]) alarm.cancel();
      this.dozing.schedule(SUSPEND_NANOS);
      return;
    }
    this.dozing.cancel();
    this.stuckAt = -1;
    this.device.resume();
    if (this.device.inArmed(this.endpoints.in)) this.armed(this.endpoints.in, false);
    if (this.queue.length) this.pace(this.bulkOut, Math.min(this.queue.length, PACKET));
  }

  fetch(fetching) {
    this.fetching = fetching;
    if (fetching && this.device.inArmed(this.endpoints.in)) this.armed(this.endpoints.in, false);
  }

  plug(plugged) {
    if (plugged === this.plugged) return;
    this.plugged = plugged;
    this.forget();
    this.queue.length = 0;
    for (const alarm of [this.control, this.bulkIn.alarm, this.bulkOut.alarm]) alarm.cancel();
    if (!plugged) {
      this.phase = 'silent';
      this.bus.schedule(SUSPEND_NANOS);
    } else if (this.device.attached) {
      this.pulledUp(true);
    }
  }

  forget() {
    this.phase = 'detached';
    this.endpoints = { in: 0, out: 0 };
    this.requests = [];
    this.request = null;
  }

  // What the device tells.

  pulledUp(attached) {
    this.forget();
    this.bus.cancel();
    if (!attached || !this.plugged) return;
    this.phase = 'attached';
    this.bus.schedule(ATTACH_NANOS + RESET_NANOS);
  }

  armed(endpoint, out) {
    if (!this.plugged || this.stuckAt >= 0) return;
    if (endpoint === 0) this.controlArmed(out);
    else if (!out && endpoint === this.endpoints.in && this.fetching) this.pace(this.bulkIn, this.device.inLength(endpoint));
    else if (out && endpoint === this.endpoints.out && this.queue.length) {
      this.pace(this.bulkOut, Math.min(this.queue.length, PACKET));
    }
  }

  /** The device refuses a request: the host leaves it at that. */
  stalled(endpoint) {
    if (endpoint === 0 && this.request) this.nextRequest();
  }

  busEvent() {
    if (this.phase === 'silent') {
      this.device.suspend();
      return;
    }
    this.phase = 'enumerating';
    this.requests = [
      standardOut(SetupRequest.SetAddress, 1),
      standardIn(DescriptorType.Device, 18),
      standardIn(DescriptorType.Configration, 9),
    ];
    this.device.busReset();
    // The first request comes when the device has had time for the reset.
    this.nextRequest(MS);
  }

  // Requests on endpoint 0: setup, data, status.

  nextRequest(delay = 0) {
    this.request = this.requests.shift() ?? null;
    if (!this.request) {
      this.phase = 'configured';
      return;
    }
    this.request.stage = 'setup';
    this.request.received = [];
    this.control.schedule(delay + packetNanos(8));
  }

  controlArmed(out) {
    const { request } = this;
    if (!request || request.stage === 'setup' || this.control.scheduled) return;
    if (out === (request.stage === 'out')) this.control.schedule(packetNanos(PACKET));
  }

  controlPacket() {
    const { request, device } = this;
    const isIn = request.dataDirection === DataDirection.DeviceToHost;
    if (request.stage === 'setup') {
      device.setup(createSetupPacket(request));
      request.stage = isIn || request.wLength === 0 ? 'in' : 'out';
      return;
    }
    if (request.stage === 'out') {
      if (device.outRoom(0) < 0) return;
      // The data of a request that has any, or else the empty packet that ends an IN request.
      device.giveOut(0, isIn ? new Uint8Array() : request.data);
      if (isIn) this.done(request);
      else request.stage = 'in';
      return;
    }
    const packet = device.takeIn(0);
    if (!packet) return;
    if (!isIn) {
      this.done(request);
      return;
    }
    request.received.push(...packet);
    if (packet.length < PACKET || request.received.length >= request.wLength) {
      request.stage = 'out';
      // The device may have been ready for the status before the data was taken.
      this.control.schedule(packetNanos(0));
    }
  }

  done(request) {
    if (request.wValue >> 8 === DescriptorType.Configration && request.wLength === 9) {
      const total = request.received[2] | (request.received[3] << 8);
      this.requests.push(standardIn(DescriptorType.Configration, total));
    } else if (request.wValue >> 8 === DescriptorType.Configration && request.received.length > 9) {
      this.endpoints = bulkEndpoints(request.received);
      this.requests.push(
        standardOut(SetupRequest.SetDeviceConfiguration, 1),
        classOut(SET_LINE_CODING, 0, LINE_CODING),
        classOut(SET_CONTROL_LINE_STATE, DTR_RTS),
      );
    }
    this.nextRequest();
  }

  // The two bulk endpoints.

  /** Lets a packet of `length` bytes come through as soon as its direction is free. */
  pace(direction, length) {
    if (direction.alarm.scheduled || this.stuckAt >= 0 || this.phase === 'detached' || this.phase === 'silent') return;
    const now = this.clock.nanos;
    direction.alarm.schedule(Math.max(direction.free, now) + packetNanos(length) - now);
  }

  takeBulk() {
    const packet = this.device.takeIn(this.endpoints.in);
    if (!packet) return;
    this.bulkIn.free = this.clock.nanos;
    if (packet.length) this.receive(packet);
  }

  giveBulk() {
    const room = this.device.outRoom(this.endpoints.out);
    if (room < 0 || this.queue.length === 0 || this.endpoints.out === 0) return;
    const packet = Uint8Array.from(this.queue.splice(0, Math.min(room, PACKET)));
    this.bulkOut.free = this.clock.nanos;
    this.device.giveOut(this.endpoints.out, packet);
    if (this.queue.length) this.pace(this.bulkOut, Math.min(this.queue.length, PACKET));
  }
}

function packetNanos(length) {
  return (length + OVERHEAD_BYTES) * NANOS_PER_BYTE;
}
