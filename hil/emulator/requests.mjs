// What a client may ask for: one JSON object per request, one per answer. hil/emulator/README.md has the table.
import { Profile } from './profile.mjs';
import { INPUTS, LINES, OUTPUTS } from './machine.mjs';
import { readImage } from './image.mjs';
import { Rtt } from './rtt.mjs';

const RAM = 0x20000000;
const FLASH = 0x10000000;

/** A field of a request that is not as it must be. */
class BadRequest extends Error {}

const isInteger = (value) => Number.isSafeInteger(value);
const isList = (value) => Array.isArray(value) && value.every(isInteger);

const KINDS = {
  cycle: [(value) => isInteger(value) && value >= 0, 'a cycle, 0 or more'],
  count: [(value) => isInteger(value) && value >= 0, 'an integer, 0 or more'],
  positive: [(value) => isInteger(value) && value > 0, 'an integer above 0'],
  word: [(value) => isInteger(value) && value >= 0 && value <= 0xffffffff, 'an unsigned 32-bit integer'],
  level: [(value) => value === 0 || value === 1, '0 or 1'],
  input: [(value) => INPUTS.has(value), `one of ${[...INPUTS].join(', ')}`],
  output: [(value) => OUTPUTS.has(value), `one of ${[...OUTPUTS].join(', ')}`],
  list: [isList, 'a list of integers'],
  flag: [(value) => typeof value === 'boolean', 'true or false'],
  path: [(value) => typeof value === 'string' && value !== '', 'a path'],
  hex: [(value) => typeof value === 'string' && /^([0-9a-f]{2})*$/i.test(value), 'bytes in hexadecimal'],
  ends: [
    (value) => Array.isArray(value) && value.every((end) => end === 'frame' || end === 'edge'),
    'a list of "frame" and "edge"',
  ],
};

/** The value of `field`, checked; `fallback` where it is left out. */
function take(request, field, kind, ...fallback) {
  const value = request[field];
  if (value === undefined && fallback.length) return fallback[0];
  const [valid, expected] = KINDS[kind];
  if (!valid(value)) {
    const found = value === undefined ? 'nothing' : JSON.stringify(value);
    throw new BadRequest(`${request.op}: ${field}: expected ${expected}, found ${found}`);
  }
  return value;
}

const hex = (bytes) => Buffer.from(bytes).toString('hex');

/** Answers requests with what `machine` does. */
export class Requests {
  constructor(machine) {
    this.machine = machine;
    this.rtt = new Rtt(machine.image);
  }

  /** Answers one line. */
  answer(line) {
    let request;
    try {
      request = JSON.parse(line);
    } catch {
      return { error: 'expected one JSON object per line' };
    }
    const handler = Object.hasOwn(HANDLERS, request?.op) ? HANDLERS[request.op] : undefined;
    if (!handler) return { error: `op: expected one of ${Object.keys(HANDLERS).join(', ')}` };
    try {
      return handler(this, this.machine, request);
    } catch (error) {
      if (error instanceof BadRequest) return { error: error.message };
      throw error;
    }
  }
}

const HANDLERS = {
  run({ rtt }, machine, request) {
    const why = machine.run(take(request, 'cycles', 'count'), take(request, 'until', 'ends', []));
    const answer = {
      cycle: machine.cycle,
      why,
      received: hex(machine.received),
      edges: machine.edges.slice(),
      rtt: rtt.take(machine.chip.mcu).toString('hex'),
    };
    machine.received.length = 0;
    machine.edges.length = 0;
    return answer;
  },

  send(_, machine, request) {
    const bytes = Buffer.from(take(request, 'bytes', 'hex'), 'hex');
    const arrives = machine.send(bytes, take(request, 'at', 'cycle', machine.cycle));
    return arrives === undefined ? {} : { arrives };
  },

  drive(_, machine, request) {
    const pin = take(request, 'gpio', 'input');
    machine.drive(pin, take(request, 'level', 'level'), take(request, 'at', 'cycle', machine.stamp));
    return {};
  },

  jumper(_, machine, request) {
    machine.jumper(take(request, 'from', 'output'), take(request, 'to', 'input'));
    return {};
  },

  strobe(_, machine, request) {
    machine.setStrobe(
      take(request, 'off', 'flag', false)
        ? null
        : {
            delay: take(request, 'delay', 'count'),
            width: take(request, 'width', 'count'),
            ignore: take(request, 'ignore', 'list', []),
            extra: take(request, 'extra', 'list', []),
          },
    );
    return {};
  },

  vsync(_, machine, request) {
    machine.setVsync(
      take(request, 'off', 'flag', false)
        ? null
        : {
            first: take(request, 'first', 'cycle'),
            period: take(request, 'period', 'positive'),
            width: take(request, 'width', 'positive'),
            jitter: take(request, 'jitter', 'count', 0),
            seed: take(request, 'seed', 'count', 0),
            missing: take(request, 'missing', 'list', []),
            double: take(request, 'double', 'list', []),
          },
    );
    return {};
  },

  read(_, machine, request) {
    const address = take(request, 'address', 'word');
    const length = take(request, 'length', 'count');
    const memory = memoryAt(machine, address, length);
    if (memory) return { bytes: hex(memory) };
    if (address % 4 || length % 4) {
      throw new BadRequest('read: address: expected RAM, flash, or whole words of registers');
    }
    const words = Buffer.alloc(length);
    for (let at = 0; at < length; at += 4) words.writeUInt32LE(machine.chip.mcu.readUint32(address + at) >>> 0, at);
    return { bytes: hex(words) };
  },

  write(_, machine, request) {
    const address = take(request, 'address', 'word');
    const bytes = Buffer.from(take(request, 'bytes', 'hex'), 'hex');
    const memory = memoryAt(machine, address, bytes.length);
    if (!memory) throw new BadRequest('write: address: expected RAM or flash');
    memory.set(bytes);
    return {};
  },

  jump(_, machine, request) {
    machine.jump(
      take(request, 'address', 'word'),
      take(request, 'r0', 'word', undefined),
      take(request, 'primask', 'level', undefined),
    );
    return {};
  },

  plug(_, machine, request) {
    machine.plug(take(request, 'in', 'flag'));
    return {};
  },

  fetch(_, machine, request) {
    machine.fetch(take(request, 'on', 'flag'));
    return {};
  },

  doze(_, machine, request) {
    machine.doze(take(request, 'on', 'flag'));
    return {};
  },

  wedge(_, machine) {
    machine.wedge();
    return {};
  },

  flash(requests, machine, request) {
    if (!machine.inBootLoader) throw new BadRequest('flash: expected a chip in its boot loader, found one that runs');
    machine.take(readImage(take(request, 'image', 'path')));
    requests.rtt = new Rtt(machine.image);
    return {};
  },

  power(_, machine) {
    machine.power();
    return {};
  },

  levels(_, { wires }) {
    const gpio = {};
    for (const pin of Object.values(LINES)) gpio[pin] = { level: wires.levels[pin], driven: wires.isDriven(pin) };
    return { gpio };
  },

  stats(_, machine) {
    const { reads, misses } = machine.flashReads;
    const longest = machine.longestMasked;
    machine.longestMasked = 0;
    return {
      cycle: machine.cycle,
      busy: machine.busy,
      clock_hz: machine.chip.mcu.clkSys,
      uart_overruns: machine.overruns + machine.chip.uart.overruns,
      flash_reads: reads,
      flash_misses: misses,
      longest_masked: longest,
      warnings: Object.fromEntries(machine.warnings),
    };
  },

  profile(_, machine, request) {
    if (request.on !== undefined) {
      machine.profile = take(request, 'on', 'flag') ? new Profile(machine.image) : null;
      return {};
    }
    return { samples: machine.profile?.samples() ?? [] };
  },
};

/** The bytes of RAM or flash from `address` on, or null. */
function memoryAt({ chip }, address, length) {
  for (const [start, memory] of [
    [RAM, chip.mcu.sram],
    [FLASH, chip.mcu.flash],
  ]) {
    if (address >= start && address + length <= start + memory.length) {
      return memory.subarray(address - start, address - start + length);
    }
  }
  return null;
}
