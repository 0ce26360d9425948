// The page of a measurement in a browser, opened as a file: it draws, answers hands and keys, and asks nothing of any network.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdirSync, mkdtempSync, rmSync, statSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { chromium } from "playwright-core";

const root = new URL("../..", import.meta.url).pathname;
const rcg = join(root, "target/debug/rcg");
// Screenshots stay here, to be looked at.
const pictures = join(root, "target/page");
const folder = mkdtempSync(join(tmpdir(), "rcg-page-"));
const VIEWS = ["light", "hemisphere", "plane", "lobe", "sphere"];

let browser;
before(async () => {
  mkdirSync(pictures, { recursive: true });
  const measured = join(folder, "m");
  const plan = ["--step", "10", "--image-size", "48", "--brackets", "2"];
  execFileSync(rcg, ["-q", "measure", "--rig", "rcg-1-16bit", "--calibration", "none", "--out", measured, ...plan]);
  execFileSync(rcg, ["-q", "report", measured, "--out", join(folder, "alone.html")]);
  const args = ["--enable-unsafe-swiftshader", ...(process.getuid() === 0 ? ["--no-sandbox"] : [])];
  browser = await chromium.launch({ executablePath: process.env.RCG_CHROMIUM ?? "/usr/bin/chromium", args });
});
after(async () => {
  await browser?.close();
  rmSync(folder, { recursive: true });
});

/** A page that is drawn, with all that went wrong on it, and all that it asked for. */
const opened = async (name, options = {}) => {
  const context = await browser.newContext({ viewport: { width: 1100, height: 1600 }, ...options });
  const page = await context.newPage();
  const wrong = [];
  page.on("console", (message) => { if (message.type() === "error") wrong.push(message.text()); });
  page.on("pageerror", (error) => wrong.push(error.message));
  page.on("request", (request) => { if (!/^(file|data|blob):/.test(request.url())) wrong.push(`asked for ${request.url()}`); });
  await page.goto(`file://${join(folder, name)}`);
  await page.waitForSelector("html[data-ready=yes]");
  return { page, wrong, context };
};
const settled = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
/** A view's pixels as bytes. */
const pixels = (page, id) => page.evaluate((id) => {
  const copy = Object.assign(document.createElement("canvas"), { width: 160, height: 160 });
  const pen = copy.getContext("2d");
  pen.drawImage(document.getElementById(id), 0, 0, 160, 160);
  return [...pen.getImageData(0, 0, 160, 160).data];
}, id);
const state = async (page) => { await settled(page); return page.textContent("#state"); };

test("every view is drawn, in the light and in the dark", async () => {
  assert(statSync(join(folder, "m/report.html")).size < 8e6);
  for (const colorScheme of ["light", "dark"]) {
    const { page, wrong, context } = await opened("m/report.html", { colorScheme });
    await settled(page);
    for (const id of VIEWS) {
      const shown = await pixels(page, id);
      assert(new Set(shown).size > 8, `${id} is empty`);
    }
    await page.screenshot({ path: join(pictures, `page-${colorScheme}.png`), fullPage: true });
    assert.deepEqual(wrong, []);
    await context.close();
  }
});

test("hands and keys choose light, view, lobe and lamp", async () => {
  const { page, wrong, context } = await opened("m/report.html");
  assert.match(await state(page), /Light from θ 45\.0°, φ 0\.0° \(\d+ of \d+ directions are here\)/);
  const at = async (id, x, y) => {
    await page.locator(`#${id}`).scrollIntoViewIfNeeded();
    const box = await page.locator(`#${id}`).boundingBox();
    return [box.x + x * box.width, box.y + y * box.height];
  };
  const changed = async (id, act) => {
    await settled(page);
    const old = await pixels(page, id);
    await act();
    await settled(page);
    assert.notDeepEqual(await pixels(page, id), old, id);
  };
  // A light at 90°, seen as the hemisphere, the plane and the lobe.
  for (const id of ["hemisphere", "plane", "lobe"]) {
    await changed(id, async () => page.mouse.click(...(await at("light", 0.5, id === "plane" ? 0.3 : 0.7))));
  }
  await changed("light", async () => { await page.focus("#light"); await page.keyboard.press("ArrowUp"); });
  // What is read is said: in the hole there is none.
  await page.mouse.move(...(await at("hemisphere", 0.45, 0.2)));
  assert.match(await state(page), /Seen from θ \d+\.\d°, φ \d+\.\d°: f = [\d.]+, [\d.]+, [\d.]+ 1\/sr, σ [\d.]+ %, merged; reference/);
  await page.mouse.move(...(await at("hemisphere", 0.5, 0.5)));
  assert.match(await state(page), /no value: hole/);
  await page.focus("#hemisphere");
  for (let i = 0; i < 13; i++) await page.keyboard.press("ArrowLeft");
  assert.match(await state(page), /f = /);
  for (const quantity of ["f", "sigma", "origin", "difference", "score"]) {
    await changed("hemisphere", () => page.selectOption("#choose-quantity", quantity));
  }
  await page.screenshot({ path: join(pictures, "score.png"), fullPage: true });
  await page.selectOption("#choose-channel", "2");
  await changed("lobe", async () => { await page.focus("#lobe"); await page.keyboard.press("ArrowRight"); });
  await changed("sphere", async () => page.mouse.click(...(await at("sphere", 0.7, 0.6))));
  assert.match(await state(page), /Lamp of the sphere at θ (2|3)\d°, φ 3[34]\d°/);
  await changed("sphere", async () => { await page.focus("#sphere"); await page.keyboard.press("ArrowUp"); });
  await changed("sphere", () => page.selectOption("#choose-material", "reference"));
  assert.deepEqual(wrong, []);
  await context.close();
});

test("fingers do, too", async () => {
  const { page, wrong, context } = await opened("m/report.html", { hasTouch: true });
  const before = await state(page);
  await page.locator("#light").scrollIntoViewIfNeeded();
  const box = await page.locator("#light").boundingBox();
  await page.touchscreen.tap(box.x + 0.3 * box.width, box.y + 0.5 * box.height);
  assert.notEqual(await state(page), before);
  assert.deepEqual(wrong, []);
  await context.close();
});

test("a page made afterwards has the same views, without a reference where none is named", async () => {
  const { page, wrong, context } = await opened("alone.html");
  await settled(page);
  for (const id of VIEWS) assert(new Set(await pixels(page, id)).size > 8, `${id} is empty`);
  assert.equal(await page.locator("#choose-material").count(), 0);
  assert.deepEqual(await page.locator("#choose-quantity option").evaluateAll((all) => all.map((one) => one.value)), ["log", "f", "sigma", "origin"]);
  assert.deepEqual(wrong, []);
  await context.close();
});

test("it prints without its controls", async () => {
  const { page, context } = await opened("m/report.html");
  await page.emulateMedia({ media: "print" });
  assert.equal(await page.locator("#controls").isVisible(), false);
  const bytes = await page.pdf({ path: join(pictures, "page.pdf") });
  assert(bytes.length > 20_000);
  await context.close();
});
