// The USB controller in device mode, as its host sees it: buffers are handed over packet by packet.
//
// # Design
// The firmware arms a buffer by setting AVAILABLE in its control word; it stays armed until the host has asked
// for the packet (`takeIn`) or sent one (`giveOut`), and only then AVAILABLE falls and the interrupt comes.
//
// Stock clears AVAILABLE in the moment in which it is set: an OUT endpoint looks as if an empty packet had come.
// It answers for a host that is always faster than the device, cannot be unplugged, and never lets the firmware
// clear SUSPENDED.
import { RPUSBController } from '../stock.mjs';

const BUFFER_CONTROL = 0x80;
const BUFFER_CONTROL_END = 0x100;
const AVAILABLE = 1 << 10;
const STALL = 1 << 11;
const FULL = 1 << 15;
const LENGTH = 0x3ff;
const DOUBLE_BUFFER = 1 << 30;

const MAIN_CTRL = 0x40;
const SOF_RD = 0x48;
const SIE_CTRL = 0x4c;
const SIE_STATUS = 0x50;
const PULLUP_EN = 1 << 16;
const BUS_RESET = 1 << 19;
const SETUP_REC = 1 << 17;
const CONNECTED = 1 << 16;
const RESUME = 1 << 11;
const SUSPENDED = 1 << 4;
const FRAME_NANOS = 1e6;

export class UsbDevice extends RPUSBController {
  constructor(rp2040, name) {
    super(rp2040, name);
    /** The host: `armed(endpoint, out)`, `stalled(endpoint)` and `pulledUp(on)` are called. */
    this.host = null;
    this.pullup = false;
  }

  /** Whether the device shows itself on the bus. */
  get attached() {
    return this.pullup && !!(this.mainCtrl & 1);
  }

  readUint32(offset) {
    if (offset === SOF_RD && this.host?.stuckAt >= 0) return this.host.stuckAt;
    if (offset === SOF_RD) return Math.floor(this.rp2040.clock.nanos / FRAME_NANOS) & 0x7ff;
    return super.readUint32(offset);
  }

  writeUint32(offset, value) {
    if (offset === SIE_STATUS && this.rawWriteValue & SUSPENDED) this.sieStatus &= ~SUSPENDED;
    const before = this.attached;
    super.writeUint32(offset, value);
    if (offset === SIE_CTRL) this.pullup = !!(value & PULLUP_EN);
    if ((offset === SIE_CTRL || offset === MAIN_CTRL) && this.attached !== before) {
      this.host?.pulledUp(this.attached);
    }
  }

  /** The firmware has written to the packet memory. */
  DPRAMUpdated(offset, value) {
    if (offset < BUFFER_CONTROL || offset >= BUFFER_CONTROL_END) return;
    const endpoint = (offset - BUFFER_CONTROL) >> 3;
    const out = !!(offset & 4);
    if (value & STALL) this.host?.stalled(endpoint);
    else if (value & AVAILABLE) {
      if (endpoint > 0 && this.readEndpointControlReg(endpoint, out) & DOUBLE_BUFFER) {
        this.warn(`endpoint ${endpoint} is double-buffered, which is not modelled`);
      }
      this.host?.armed(endpoint, out);
    }
  }

  /** The packet of an IN endpoint, or null if there is none (NAK). */
  takeIn(endpoint) {
    const register = BUFFER_CONTROL + 8 * endpoint;
    const control = this.rp2040.usbDPRAMView.getUint32(register, true);
    if (!(control & AVAILABLE)) return null;
    const start = this.getEndpointBufferOffset(endpoint, false);
    const packet = this.rp2040.usbDPRAM.slice(start, start + (control & LENGTH));
    this.rp2040.usbDPRAMView.setUint32(register, control & ~(AVAILABLE | FULL), true);
    this.indicateBufferReady(endpoint, false);
    return packet;
  }

  /** Whether an IN endpoint holds a packet. */
  inArmed(endpoint) {
    return !!(this.rp2040.usbDPRAMView.getUint32(BUFFER_CONTROL + 8 * endpoint, true) & AVAILABLE);
  }

  /** Length of the packet that an IN endpoint holds, in bytes. */
  inLength(endpoint) {
    return this.rp2040.usbDPRAMView.getUint32(BUFFER_CONTROL + 8 * endpoint, true) & LENGTH;
  }

  /** How many bytes an OUT endpoint takes now, or −1 if it is not armed (NAK). */
  outRoom(endpoint) {
    const control = this.rp2040.usbDPRAMView.getUint32(BUFFER_CONTROL + 8 * endpoint + 4, true);
    return control & AVAILABLE ? control & LENGTH : -1;
  }

  /** A packet for an OUT endpoint that is armed. */
  giveOut(endpoint, packet) {
    const register = BUFFER_CONTROL + 8 * endpoint + 4;
    const control = this.rp2040.usbDPRAMView.getUint32(register, true);
    this.rp2040.usbDPRAM.set(packet, this.getEndpointBufferOffset(endpoint, true));
    this.rp2040.usbDPRAMView.setUint32(
      register,
      (control & ~(AVAILABLE | LENGTH)) | FULL | packet.length,
      true,
    );
    this.indicateBufferReady(endpoint, true);
  }

  setup(packet) {
    this.rp2040.usbDPRAM.set(packet, 0);
    this.sieStatus |= SETUP_REC;
    this.sieStatusUpdated();
  }

  busReset() {
    this.sieStatus = (this.sieStatus & ~SUSPENDED) | BUS_RESET | CONNECTED;
    this.sieStatusUpdated();
  }

  /** The bus has been silent for 3 ms. */
  suspend() {
    this.sieStatus = (this.sieStatus & ~CONNECTED) | SUSPENDED;
    this.sieStatusUpdated();
  }

  /** The host goes on. */
  resume() {
    this.sieStatus = (this.sieStatus & ~SUSPENDED) | RESUME | CONNECTED;
    this.sieStatusUpdated();
  }
}
