// Opens a report in headless Chromium without network: axe-core, console, requests, overflow, interaction, print.
//
//   node check.mjs REPORT.html [FOLDER FOR SCREENSHOTS]
//
// Prints one JSON object. CHROMIUM names the browser, by default /usr/bin/chromium.
import { readFileSync, mkdirSync, mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { createRequire } from "node:module";
import puppeteer from "puppeteer-core";

const [report, shots] = process.argv.slice(2);
if (!report) {
  console.error("usage: node check.mjs REPORT.html [FOLDER FOR SCREENSHOTS]");
  process.exit(2);
}
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const SIZES = { phone: [390, 844], laptop: [1366, 768] };
const profile = mkdtempSync(join(tmpdir(), "report-check-"));
if (shots) mkdirSync(shots, { recursive: true });

const browser = await puppeteer.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  headless: true,
  userDataDir: profile,
  args: ["--no-sandbox", "--disable-gpu", "--force-prefers-reduced-motion"],
});
const result = { axe_version: axe.match(/axe v([\d.]+)/)?.[1], console: [], requests: [], axe: {}, sizes: {}, explorer: null, print: null };
try {
  const page = await browser.newPage();
  page.on("console", (m) => ["error", "warn"].includes(m.type()) && result.console.push(m.text()));
  page.on("pageerror", (e) => result.console.push(String(e)));
  page.on("request", (r) => {
    if (!r.url().startsWith("file:") && !r.url().startsWith("data:")) result.requests.push(r.url());
  });
  await page.setOfflineMode(true);
  const started = Date.now();
  await page.goto("file://" + resolve(report), { waitUntil: "load" });
  result.load_ms = Date.now() - started;
  for (const [name, [width, height]] of Object.entries(SIZES)) {
    await page.setViewport({ width, height, deviceScaleFactor: 1 });
    if (shots) await page.screenshot({ path: join(shots, `${name}.png`) });
    if (shots) await page.screenshot({ path: join(shots, `${name}-full.png`), fullPage: true });
    result.sizes[name] = await page.evaluate(() => ({
      // Wider than the screen means that the whole page scrolls sideways.
      overflow_px: document.documentElement.scrollWidth - document.documentElement.clientWidth,
      height_px: document.documentElement.scrollHeight,
    }));
  }
  result.explorer = await page.evaluate(() => {
    const run = document.getElementById("runs-run");
    const channel = document.getElementById("runs-channel");
    if (!run || !channel) return null;
    const line = () => document.querySelector("#runs .simulated")?.getAttribute("d");
    const before = line();
    channel.selectedIndex = channel.options.length - 1;
    channel.dispatchEvent(new Event("change"));
    const other = line();
    const plot = document.querySelector("#runs svg");
    const box = plot.getBoundingClientRect();
    const at = { clientX: box.left + box.width / 2, clientY: box.top + box.height / 3, bubbles: true };
    plot.dispatchEvent(new PointerEvent("pointermove", at));
    return {
      runs: run.options.length,
      channels: channel.options.length,
      redrawn: Boolean(before) && Boolean(other) && before !== other,
      reading: document.querySelector("#runs output")?.textContent ?? "",
    };
  });
  // Everything unfolded, so that nothing hides from the check.
  await page.evaluate(() => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
  for (const [name, [width, height]] of Object.entries(SIZES)) {
    await page.setViewport({ width, height, deviceScaleFactor: 1 });
    await page.evaluate(axe);
    const found = await page.evaluate(() => window.axe.run(document, { resultTypes: ["violations", "incomplete"] }));
    const brief = (v) => ({ id: v.id, impact: v.impact, nodes: v.nodes.length, first: v.nodes[0]?.html.slice(0, 160) });
    result.axe[name] = {
      rules_passed: found.passes.length,
      violations: found.violations.map(brief),
      unclear: found.incomplete.map(brief),
    };
  }
  if (shots) {
    await page.reload({ waitUntil: "load" });
    await page.pdf({ path: join(shots, "print.pdf"), preferCSSPageSize: true, printBackground: false });
    result.print = "print.pdf";
  }
} finally {
  await browser.close();
  rmSync(profile, { recursive: true, force: true });
}
console.log(JSON.stringify(result, null, 1));
