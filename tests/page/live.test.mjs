// The page of `rcg live` in a browser: it shows the instrument, answers hands and keys, and nobody else.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdirSync, mkdtempSync, readFileSync, rmSync } from "node:fs";
import { request } from "node:http";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { chromium } from "playwright-core";

const root = new URL("../..", import.meta.url).pathname;
const rcg = process.env.RCG ?? join(root, "target/debug/rcg");
const pictures = process.env.RCG_PICTURES ?? join(root, "target/page");
const folder = mkdtempSync(join(tmpdir(), "rcg-live-"));
// A coarse projector: its stripes are few, and quickly drawn.
const rig = join(root, "tests/page/live.toml");

let browser, server, url, token, host;
before(async () => {
  mkdirSync(pictures, { recursive: true });
  const args = ["live", "--rig", rig, "--image-size", "128", "--no-open", "--json", "--out", join(folder, "calibration")];
  server = spawn(rcg, args, { stdio: ["ignore", "pipe", "inherit"] });
  ({ url } = JSON.parse(await new Promise((done) => server.stdout.once("data", (text) => done(String(text))))));
  [, host, token] = /^http:\/\/([^/]+)\/#(.+)$/.exec(url);
  const flags = process.getuid() === 0 ? ["--no-sandbox"] : [];
  browser = await chromium.launch({ executablePath: process.env.RCG_CHROMIUM ?? "/usr/bin/chromium", args: flags });
});
after(async () => {
  await browser?.close();
  server?.kill();
  rmSync(folder, { recursive: true });
});

/** A page that shows the instrument, with all that went wrong on it, and all that it asked for elsewhere. */
const opened = async (options = {}) => {
  const context = await browser.newContext({ viewport: { width: 1300, height: 1000 }, ...options });
  const page = await context.newPage();
  const wrong = [];
  page.on("console", (message) => { if (message.type() === "error") wrong.push(message.text()); });
  page.on("pageerror", (error) => wrong.push(error.message));
  page.on("request", (asked) => { if (!asked.url().startsWith(`http://${host}/`) && !/^(data|ws):/.test(asked.url())) wrong.push(`asked for ${asked.url()}`); });
  await page.goto(url);
  await page.waitForSelector("html[data-ready=yes]", { timeout: 60_000 });
  return { page, wrong, context };
};
const colours = (page, id) => page.evaluate((id) => {
  const canvas = document.getElementById(id);
  return new Set(new Uint32Array(canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data.buffer)).size;
}, id);
const says = (page, id, what) => page.waitForFunction(([id, what]) => new RegExp(what).test(document.getElementById(id).textContent), [id, what.source], { timeout: 40_000 });

/** The status and the words of an answer to a request with these headers. */
const asked = (path, { method = "GET", headers = {}, body = "" } = {}) => new Promise((done, fail) => {
  const [name, port] = host.split(":");
  const sent = request({ host: name, port, path, method, headers }, (answer) => {
    let text = "";
    answer.on("data", (part) => { text += part; });
    answer.on("end", () => done({ status: answer.statusCode, text }));
  });
  sent.on("error", fail);
  sent.end(body);
});
const bearer = () => ({ Authorization: `Bearer ${token}` });

test("it draws in the light and in the dark, wide and on a phone", async () => {
  for (const [name, options] of [["light", {}], ["dark", { colorScheme: "dark" }], ["phone", { viewport: { width: 390, height: 844 }, hasTouch: true }]]) {
    const { page, wrong, context } = await opened(options);
    await says(page, "figures", /128×128 pixels, picture \d+/);
    await says(page, "edges", /horizon: seen \d+\.\d px from where it is expected/);
    for (const id of ["image", "histogram", "focus"]) assert((await colours(page, id)) > 2, `${id} is empty`);
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth > innerWidth), false, `${name} is too wide`);
    await page.screenshot({ path: join(pictures, `live-${name}.png`), fullPage: true });
    assert.deepEqual(wrong, []);
    await context.close();
  }
});

test("hands and keys choose what is shown, and every tab shows the same", async () => {
  const { page, wrong, context } = await opened();
  const other = await opened();
  await page.keyboard.press("b");
  await says(other.page, "held", /shown: black/);
  await page.keyboard.press("w");
  await says(other.page, "held", /shown: white/);
  await says(other.page, "checklist", /median of \d+ with white, \d+ with black/);
  // A spot in a mirror is seen where it is expected.
  await page.click("[data-hold='mirror 0 0']");
  await page.click("#spot button");
  await says(other.page, "edges", /spot: seen \d+\.\d px/);
  // A field that is wrong is answered with a sentence.
  await page.fill("#exposure", "0.01");
  await page.click("#expose button");
  await says(other.page, "strobe", /STROBE 5\.0 µs after the trigger, 10\.0 µs long/);
  await page.fill("#gain", "99");
  await page.click("#amplify button");
  await says(page, "problem", /gain: expected 0 to 24 dB/);
  // Single triggers.
  await page.focus("#image");
  await page.keyboard.press(" ");
  await says(page, "run", /go on/);
  const number = async () => Number(/picture (\d+)/.exec(await page.textContent("#figures"))[1]);
  await page.waitForTimeout(500);
  const first = await number();
  await page.keyboard.press("f");
  await says(other.page, "figures", new RegExp(`picture ${first + 1},`));
  await page.waitForTimeout(500);
  assert.equal(await number(), first + 1);
  await page.keyboard.press(" ");
  await page.focus("#image");
  await page.keyboard.press("a");
  // A reload changes nothing.
  await page.reload();
  await says(page, "held", /in the holder: mirror 0 0; shown: spot 30 0/);
  await page.click("[data-hold='lambert:0.9']");
  await page.click("[data-show=white]");
  await says(other.page, "edges", /horizon: seen/);
  // What was refused was said by the browser, too.
  assert.deepEqual(wrong.filter((line) => !line.includes("400 (Bad Request)")), []);
  assert.deepEqual(other.wrong, []);
  await context.close();
  await other.context.close();
});

test("a camera that dies is named, and is there again when it returns", async () => {
  const { page, wrong, context } = await opened();
  await page.click("#plug");
  await says(page, "problem", /camera virtual: the connection has ended/);
  await page.click("#advise");
  await says(page, "problem", /camera virtual/);
  await page.click("#plug");
  await page.waitForFunction(() => document.getElementById("plug").textContent.startsWith("unplug"));
  await page.click("#auto");
  await page.waitForFunction(() => document.getElementById("problem").hidden);
  await says(page, "edges", /horizon: seen/);
  assert.deepEqual(wrong.filter((line) => !line.includes("400 (Bad Request)")), []);
  await context.close();
});

test("other sites, other names, and whoever has no token are refused", async () => {
  const wish = { method: "POST", body: '"fire"' };
  assert.equal((await asked("/do", { ...wish, headers: bearer() })).status, 200);
  for (const [headers, status, sentence] of [
    [{}, 401, /expected Bearer and the token/],
    [{ Authorization: `Bearer ${token.replace(/.$/, (last) => (last === "0" ? "1" : "0"))}` }, 401, /expected Bearer/],
    [{ ...bearer(), Origin: "http://evil.example" }, 403, /Origin: expected http:\/\/127\.0\.0\.1:\d+, found http:\/\/evil\.example/],
    [{ ...bearer(), Host: "evil.example" }, 403, /Host: expected 127\.0\.0\.1:\d+, found evil\.example/],
  ]) {
    const answer = await asked("/do", { ...wish, headers });
    assert.equal(answer.status, status, answer.text);
    assert.match(answer.text, sentence);
  }
  for (const path of ["/", "/state", "/live", "/page.js"]) assert.equal((await asked(path, { headers: { ...bearer(), Host: "evil.example" } })).status, 403, path);
  assert.equal((await asked("/state")).status, 401);
  const bad = await asked("/do", { method: "POST", headers: bearer(), body: "{" });
  assert.equal(bad.status, 400);
  assert.match(bad.text, /expected a wish such as/);
  // A page without the token says so, and a socket without it is told nothing.
  const context = await browser.newContext();
  const page = await context.newPage();
  await page.goto(`http://${host}/`);
  await says(page, "problem", /expected the address that `rcg live` printed/);
  await page.goto(`http://${host}/#${"0".repeat(32)}`);
  await page.reload();
  await says(page, "problem", /expected the token of the program that runs/);
  assert.equal(await page.textContent("#rig"), "");
  await context.close();
});

test("a hundred connections and a request of a hundred megabytes leave it as it was", async () => {
  const memory = () => Number(/VmRSS:\s+(\d+)/.exec(readFileSync(`/proc/${server.pid}/status`, "utf8"))[1]) / 1024;
  const before = memory();
  const key = Buffer.from("0123456789abcdef").toString("base64");
  const sockets = [];
  const statuses = await Promise.all(Array.from({ length: 100 }, () => new Promise((done) => {
    const [name, port] = host.split(":");
    const sent = request({ host: name, port, path: "/live", headers: { Connection: "Upgrade", Upgrade: "websocket", "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": key } });
    sent.on("upgrade", (_, socket) => { socket.on("error", () => {}); sockets.push(socket); done(101); });
    sent.on("response", (answer) => { answer.resume(); done(answer.statusCode); });
    sent.on("error", () => done(0));
    sent.end();
  })));
  assert(statuses.includes(101) && statuses.includes(503), String(statuses));
  sockets.forEach((socket) => socket.destroy());
  // It is refused while it is still being sent, and the connection is closed.
  const answer = await new Promise((done) => {
    const [name, port] = host.split(":");
    const sent = request({ host: name, port, path: "/do", method: "POST", headers: bearer() }, (found) => { found.resume(); found.on("error", () => {}); done({ status: found.statusCode }); });
    sent.on("socket", (socket) => socket.on("error", () => {}));
    sent.on("error", () => done({ status: 0 }));
    sent.end(Buffer.alloc(100e6));
  });
  assert([0, 413].includes(answer.status), String(answer.status));
  const { page, context } = await opened();
  await says(page, "figures", /picture \d+/);
  await context.close();
  assert(memory() < before + 60, `${before} MiB before, ${memory()} MiB now`);
});

test("a newcomer aligns a rig that is off, and calibrates it", { timeout: 900_000 }, async () => {
  const { page, wrong, context } = await opened();
  await page.click("[data-show=black]");
  await says(page, "held", /shown: black/);
  await page.click("[data-show=white]");
  await says(page, "held", /shown: white/);
  const granted = (id) => Promise.all([page.waitForResponse((answer) => answer.url().endsWith("/do"), { timeout: 60_000 }), page.click(id)]);
  await granted("#misalign button");
  await granted("#auto");
  const number = async () => Number(/picture (\d+)/.exec(await page.textContent("#figures"))[1]);
  /** A screenshot, after some pictures of the rig as it stands now. */
  const shot = async (name) => {
    for (const first = await number(); (await number()) < first + 5;) await page.waitForTimeout(200);
    await page.screenshot({ path: join(pictures, name), fullPage: true });
  };
  await shot("live-misaligned.png");
  for (let round = 1; round <= 5; round++) {
    await page.click("#advise");
    await page.waitForFunction((round) => document.getElementById("rounds").textContent.includes(`round ${round})`), round, { timeout: 300_000 });
    await page.waitForFunction(() => document.getElementById("task").hidden);
    if (round === 1) await shot("live-advice.png");
    if (/Aligned/.test(await page.textContent("#verdict"))) break;
    assert(round < 5, await page.textContent("#verdict"));
    await page.click("#follow");
    await page.waitForFunction(() => document.getElementById("moves").children.length === 0);
  }
  await page.click("#auto");
  await says(page, "edges", /horizon: seen \d+\.\d px/);
  await shot("live-aligned.png");
  await page.click("#calibrate");
  await page.waitForFunction(() => /calibrated: rcg calibrate photometry comes next/.test(document.getElementById("checklist").textContent), null, { timeout: 300_000 });
  await page.screenshot({ path: join(pictures, "live-calibrated.png"), fullPage: true });
  assert(JSON.parse(readFileSync(join(folder, "calibration/geometry.json"), "utf8")).camera_deg < 0.3);
  assert.deepEqual(wrong, []);
  await context.close();
});
