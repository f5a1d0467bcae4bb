// Opens the page of a test day in headless Chromium: axe-core, console, requests, overflow, and what it follows.
//
//   node check_day.mjs ADDRESS [FOLDER FOR SCREENSHOTS]
//
// Prints a line when the page is shown, and one JSON object when a line comes in and the page has followed.
import { readFileSync, mkdirSync, mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createRequire } from "node:module";
import { once } from "node:events";
import puppeteer from "puppeteer-core";

const [address, shots] = process.argv.slice(2);
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const SIZES = { phone: [390, 844], laptop: [1366, 768] };
const profile = mkdtempSync(join(tmpdir(), "day-check-"));
if (shots) mkdirSync(shots, { recursive: true });
const browser = await puppeteer.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  headless: true,
  userDataDir: profile,
  args: ["--no-sandbox", "--disable-gpu"],
});
const result = { console: [], requests: [], axe: {}, sizes: {}, first: null, then: null };
try {
  const page = await browser.newPage();
  page.on("console", (m) => ["error", "warn"].includes(m.type()) && result.console.push(m.text()));
  page.on("pageerror", (e) => result.console.push(String(e)));
  page.on("request", (r) => {
    if (!r.url().startsWith(address)) result.requests.push(r.url());
  });
  await page.goto(address, { waitUntil: "load" });
  await page.waitForSelector("#day h1", { timeout: 20000 });
  const headline = () => page.$eval("#day h1", (e) => e.textContent);
  result.first = await headline();
  for (const [name, [width, height]] of Object.entries(SIZES)) {
    await page.setViewport({ width, height, deviceScaleFactor: 1 });
    if (shots) await page.screenshot({ path: join(shots, `${name}.png`) });
    result.sizes[name] = await page.evaluate(() => ({
      overflow_px: document.documentElement.scrollWidth - document.documentElement.clientWidth,
      height_px: document.documentElement.scrollHeight,
    }));
    await page.evaluate(axe);
    const found = await page.evaluate(() => window.axe.run());
    result.axe[name] = found.violations.map((v) => `${v.id}: ${v.nodes.map((n) => n.html).join(" ").slice(0, 200)}`);
  }
  console.log("shown");
  await once(process.stdin, "data");
  await page.waitForFunction((first) => document.querySelector("#day h1").textContent !== first, { timeout: 20000 }, result.first);
  result.then = await headline();
  console.log(JSON.stringify(result));
} finally {
  await browser.close();
  rmSync(profile, { recursive: true, force: true });
  process.stdin.destroy();
}
