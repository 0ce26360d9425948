// The firmware in a machine, and just enough of the wire to make it run (protocol/ has all of it).
import fs from 'node:fs';
import { fileURLToPath } from 'node:url';
import { readImage } from '../image.mjs';
import { Machine } from '../machine.mjs';

export const ELF =
  process.env.RCG_FIRMWARE_ELF ??
  fileURLToPath(new URL('../../../target/thumbv6m-none-eabi/firmware/rcg-firmware', import.meta.url));

/** Why tests of the firmware cannot run, or false. */
export const withoutFirmware = fs.existsSync(ELF) ? false : `no firmware at ${ELF}: build it with "cargo fw"`;

const REQUEST = {
  hello: 0, status: 3, load: 4, append: 5, arm: 6, start: 7, stop: 8, abort: 9, describe: 1, boot: 15, keep: 16, keepAux: 19, repeat: 22, store: 23, stored: 24,
};

/** A postcard integer. */
export function varint(value) {
  const bytes = [];
  for (let rest = BigInt(value); ; rest >>= 7n) {
    if (rest < 0x80n) return [...bytes, Number(rest)];
    bytes.push(Number(rest & 0x7fn) | 0x80);
  }
}

/** The CRC-32 of frames. */
export function crc32(bytes) {
  let crc = ~0;
  for (const byte of bytes) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) crc = crc & 1 ? (crc >>> 1) ^ 0xedb88320 : crc >>> 1;
  }
  return ~crc >>> 0;
}

/** COBS of `payload` and its CRC-32, with the delimiter. */
export function frame(payload) {
  const crc = crc32(payload);
  const blocks = [];
  let block = [];
  const close = () => {
    blocks.push(block.length + 1, ...block);
    block = [];
  };
  for (const byte of [...payload, ...[0, 8, 16, 24].map((shift) => (crc >>> shift) & 0xff)]) {
    if (byte === 0) close();
    else if (block.push(byte) === 254) close();
  }
  close();
  return [...blocks, 0];
}

/** The payload of a frame without its delimiter; throws if the CRC is wrong. */
export function unframe(bytes) {
  const payload = [];
  for (let at = 0; at < bytes.length; ) {
    const code = bytes[at];
    payload.push(...bytes.slice(at + 1, at + code));
    at += code;
    if (at < bytes.length && code < 255) payload.push(0);
  }
  const data = payload.slice(0, -4);
  const crc = payload.slice(-4).reduce((sum, byte, i) => sum + byte * 2 ** (8 * i), 0);
  if (crc !== crc32(data)) throw new Error(`corrupt frame ${Buffer.from(bytes).toString('hex')}`);
  return data;
}

/** A step: pulses as [at, width], in ticks. */
export const step = ({ proj = [0, 0], cam = [0, 0], period }) => [...proj, ...cam, period].flatMap(varint);

/** A request as it is kept: in no session, under no number. */
export const kept = (name, fields = []) => frame([0, 0, REQUEST[name], ...fields]);

/** The requests that load a table. */
export function* loading(steps, cycles = 1, { paced = false, polarity = [0, 0, 0, 0] } = {}) {
  const when = paced ? [1, 1] : [0, 0];
  const extent = [0, ...varint(steps.length), ...varint(cycles)];
  yield ['load', [...extent, ...when, ...polarity, ...varint(0), ...varint(60_000_000)]];
  for (let first = 0; first < steps.length; first += 8) {
    const part = steps.slice(first, first + 8);
    const last = first + 8 >= steps.length ? 1 : 0;
    yield ['append', [...varint(first), ...varint(part.length), ...part.flat(), last]];
  }
}

export class Box {
  constructor({ image = readImage(ELF), bootMs = 30, ...options } = {}) {
    this.machine = new Machine(image, options);
    this.seq = 0;
    this.session = 0;
    this.edges = [];
    this.bytes = [];
    this.machine.run(bootMs * 125_000);
    this.collect();
  }

  collect() {
    const { machine } = this;
    for (let i = 0; i < machine.edges.length; i += 3) this.edges.push(machine.edges.slice(i, i + 3));
    machine.edges.length = 0;
    for (const byte of machine.received.splice(0)) this.bytes.push(byte);
  }

  run(cycles, until) {
    const why = this.machine.run(cycles, until);
    this.collect();
    return why;
  }

  /** Frames that have come and were not taken. */
  takeFrame() {
    const end = this.bytes.indexOf(0);
    if (end < 0) return null;
    return unframe(this.bytes.splice(0, end + 1).slice(0, -1));
  }

  /** Sends a request and runs until its response; events are dropped. Returns the reply's bytes. */
  request(name, fields = [], { limit = 12_500_000 } = {}) {
    const seq = ++this.seq;
    this.machine.send(frame([...varint(this.session), ...varint(seq), REQUEST[name], ...fields]));
    const end = this.machine.cycle + limit;
    for (;;) {
      const found = this.takeFrame();
      if (found?.[0] === 0) {
        const body = found.slice(1 + varint(this.session).length + varint(seq).length);
        if (body[0] !== 0) throw new Error(`${name} is refused: ${Buffer.from(body).toString('hex')}`);
        return body.slice(1);
      }
      if (found) continue;
      if (this.run(end - this.machine.cycle, ['frame']) === 'cycles') throw new Error(`${name}: no answer`);
    }
  }

  hello() {
    // Ok(Identity { protocol, schema, nonce, session }): the session stands at the end.
    const nonce = 42;
    this.session = 0;
    const reply = this.request('hello', varint(nonce));
    const tail = reply.slice(reply.lastIndexOf(nonce) + 1);
    this.session = tail.reduce((sum, byte, i) => sum + (byte & 0x7f) * 2 ** (7 * i), 0);
    return this;
  }

  /** Loads a table: played at once, or each step on its SYNC edge. */
  load(steps, cycles = 1, options = {}) {
    for (const [name, fields] of loading(steps, cycles, options)) this.request(name, fields);
    return this;
  }

  /** The power goes off and comes back; what the box had said before is forgotten. */
  power(bootMs = 30) {
    this.machine.power();
    this.machine.run(bootMs * 125_000);
    [this.edges, this.bytes] = [[], []];
    this.collect();
    return this;
  }

  start() {
    this.request('arm');
    this.request('start');
    return this;
  }
}
