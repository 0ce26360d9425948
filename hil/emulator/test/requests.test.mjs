// The lines of JSON, through the command itself and without the firmware.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { Machine } from '../machine.mjs';
import { Requests } from '../requests.mjs';
import { imageOf } from '../rig/rigs.mjs';

const MAIN = fileURLToPath(new URL('../main.mjs', import.meta.url));

function client() {
  const requests = new Requests(new Machine(imageOf([0xbf30, 0xe7fd])));
  return (request) => requests.answer(typeof request === 'string' ? request : JSON.stringify(request));
}

test('time passes only in run, by exactly what was asked for', () => {
  const ask = client();
  assert.equal(ask({ op: 'stats' }).cycle, 0);
  for (const [cycles, at] of [[1, 1], [0, 1], [999, 1000], [123_456, 124_456]]) {
    assert.deepEqual(ask({ op: 'run', cycles }), { cycle: at, why: 'cycles', received: '', edges: [], rtt: '' });
  }
});

test('edges are told once, in their order', () => {
  const ask = client();
  ask({ op: 'drive', gpio: 4, level: 1, at: 50 });
  ask({ op: 'drive', gpio: 5, level: 1, at: 20 });
  assert.deepEqual(ask({ op: 'run', cycles: 100 }).edges, [20, 5, 1, 50, 4, 1]);
  assert.deepEqual(ask({ op: 'run', cycles: 100 }).edges, []);
  assert.deepEqual(ask({ op: 'levels' }).gpio['4'], { level: 1, driven: false });
});

test('memory is read and written', () => {
  const ask = client();
  assert.deepEqual(ask({ op: 'write', address: 0x20000100, bytes: '0badcafe' }), {});
  assert.deepEqual(ask({ op: 'read', address: 0x20000101, length: 2 }), { bytes: 'adca' });
  assert.deepEqual(ask({ op: 'read', address: 0xe000ed00, length: 4 }), { bytes: '01c60c41' });
});

test('a bad request gets one sentence', () => {
  const ask = client();
  for (const [request, sentence] of [
    ['nonsense', /one JSON object per line/],
    ['null', /op: expected one of run, send/],
    [{ op: 'toString' }, /op: expected one of run, send/],
    [{ op: 'run' }, /^run: cycles: expected an integer, 0 or more, found nothing$/],
    [{ op: 'run', cycles: 1, until: ['end'] }, /^run: until: expected a list of "frame" and "edge"/],
    [{ op: 'send', bytes: 'xy' }, /^send: bytes: expected bytes in hexadecimal, found "xy"$/],
    [{ op: 'drive', gpio: 2, level: 1 }, /^drive: gpio: expected one of 4, 5, 8, 9, found 2$/],
    [{ op: 'drive', gpio: 4, level: 2 }, /^drive: level: expected 0 or 1, found 2$/],
    [{ op: 'vsync', first: 0, period: 0, width: 1 }, /^vsync: period: expected an integer above 0, found 0$/],
    [{ op: 'write', address: 0x40000000, bytes: '00' }, /^write: address: expected RAM or flash/],
  ]) {
    assert.match(ask(request).error, sentence);
  }
  assert.equal(ask({ op: 'stats' }).cycle, 0, 'nothing has happened');
});

test('the command explains itself', () => {
  for (const [options, sentence] of [
    [[], /--image: expected a file, found nothing/],
    [['--image', 'nowhere.elf'], /nowhere\.elf: cannot be read/],
    [['--image', 'x', '--link', 'spi'], /--link: expected uart or usb, found spi/],
    [['--nonsense'], /--nonsense/],
  ]) {
    const { status, stderr } = spawnSync(process.execPath, [MAIN, ...options]);
    assert.equal(status, 2);
    assert.match(stderr.toString(), sentence);
  }
});
