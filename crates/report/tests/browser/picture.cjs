// The top of a page as a picture for the README: node picture.cjs PAGE OUT.png [WIDTH HEIGHT SECONDS]
"use strict";
const path = require("node:path");
const { chromium } = require("playwright-core");
(async () => {
  const [page_path, out, width = 1180, height = 1120, seconds = 2.9] = process.argv.slice(2);
  const browser = await chromium.launch({ executablePath: process.env.CHROMIUM, args: ["--no-sandbox", "--disable-gpu", "--disable-quic"] });
  const context = await browser.newContext({ viewport: { width: Number(width), height: Number(height) }, colorScheme: "light", offline: true });
  const page = await context.newPage();
  await page.goto("file://" + path.resolve(page_path));
  await page.evaluate(() => document.fonts.ready);
  await page.evaluate((t) => window.stridemapReplays.forEach((r) => r.seek(t)), Number(seconds));
  await page.screenshot({ path: out });
  await browser.close();
})();
