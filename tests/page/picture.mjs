// A picture of the views of a report: `node picture.mjs out/report.html report.png`.
import { resolve } from "node:path";
import { argv, env, exit, getuid } from "node:process";
import { chromium } from "playwright-core";

const [, , page_file, picture] = argv;
if (!picture) {
  console.error("picture.mjs: expected a report and the picture to write, as in node picture.mjs out/report.html report.png");
  exit(2);
}
const args = ["--enable-unsafe-swiftshader", ...(getuid() === 0 ? ["--no-sandbox"] : [])];
const browser = await chromium.launch({ executablePath: env.RCG_CHROMIUM ?? "/usr/bin/chromium", args });
const page = await browser.newPage({ viewport: { width: 1000, height: 1200 } });
await page.goto(`file://${resolve(page_file)}`);
await page.waitForSelector("html[data-ready=yes]");
// Where the lobe is, so that its value is read.
const box = await page.locator("#hemisphere").boundingBox();
await page.mouse.move(box.x + 0.28 * box.width, box.y + 0.5 * box.height);
await page.waitForTimeout(500);
const top = (await page.locator("#state").boundingBox()).y;
const last = await page.locator("#sphere").boundingBox();
await page.screenshot({ path: picture, fullPage: true, clip: { x: 0, y: top, width: 1000, height: last.y + last.height + 3 - top } });
await browser.close();
