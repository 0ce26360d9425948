// The command: an emulated Pico that is spoken to in lines of JSON.
import readline from 'node:readline';
import { parseArgs } from 'node:util';
import { readImage } from './image.mjs';
import { Machine } from './machine.mjs';
import { Requests } from './requests.mjs';

const USAGE = 'usage: node main.mjs --image FILE.elf|FILE.uf2 [--link uart|usb] [--flash-cache] [--input-sync]';

function commandLine() {
  const { values } = parseArgs({
    options: {
      image: { type: 'string' },
      link: { type: 'string', default: 'uart' },
      'flash-cache': { type: 'boolean', default: false },
      'input-sync': { type: 'boolean', default: false },
    },
  });
  if (!values.image) throw new Error('--image: expected a file, found nothing');
  if (!['uart', 'usb'].includes(values.link)) {
    throw new Error(`--link: expected uart or usb, found ${values.link}`);
  }
  return values;
}

let requests;
try {
  const { image, link, 'flash-cache': flashCache, 'input-sync': inputSync } = commandLine();
  requests = new Requests(new Machine(readImage(image), { link, flashCache, inputSync }));
} catch (error) {
  console.error(`${error.message}\n${USAGE}`);
  process.exit(2);
}
for await (const line of readline.createInterface({ input: process.stdin })) {
  if (line.trim()) process.stdout.write(`${JSON.stringify(requests.answer(line))}\n`);
}
