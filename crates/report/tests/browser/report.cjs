// Reports in a browser: no console error, figures present and not empty, values on hover and by key,
// zoom, replay that plays and seeks, light and dark, phone and desk, no request leaves the file.
"use strict";
const path = require("node:path");
const { chromium } = require("playwright-core");

const out = process.env.OUT;
let passed = 0, failed = 0;
const check = (what, ok, detail = "") => {
  if (ok) { passed += 1; return; }
  failed += 1;
  console.log(`FAILED ${what} ${detail}`);
};

async function figures(page, name) {
  const list = await page.$$("figure[data-hover]");
  check(`${name}: has figures`, list.length > 0);
  for (const figure of list) {
    const id = await figure.getAttribute("id");
    const svg = await figure.$("svg");
    const box = await svg.boundingBox();
    check(`${name}/${id}: has a size`, box && box.width > 200 && box.height > 100);
    const marks = await svg.$$eval("path, circle, rect, text", (all) => all.filter((e) => {
      const b = e.getBBox();
      return b.width > 0 || b.height > 0;
    }).length);
    check(`${name}/${id}: is not empty`, marks > 10, `${marks} marks`);
    const broken = await svg.evaluate((e) => /NaN|Infinity|undefined/.test(e.outerHTML));
    check(`${name}/${id}: no NaN`, !broken);
    check(`${name}/${id}: alt text`, ((await svg.getAttribute("aria-label")) || "").length > 20);
    check(`${name}/${id}: caption`, (await figure.$eval("figcaption", (e) => e.textContent)).length > 40);
    const points = await page.$eval(`#hover-${id}`, (e) => JSON.parse(e.textContent).length);
    check(`${name}/${id}: hover values`, points > 0);
  }
  return list;
}

async function hover(page, name, figure) {
  const id = await figure.getAttribute("id");
  await figure.scrollIntoViewIfNeeded();
  const svg = await figure.$("svg");
  // Where the middle datum stands on the screen.
  const at = await svg.evaluate((e, key) => {
    const points = JSON.parse(document.getElementById(key).textContent);
    const p = points[Math.floor(points.length / 2)], r = e.getBoundingClientRect(), s = r.width / e.viewBox.baseVal.width;
    return [r.left + p[0] * s, r.top + p[1] * s];
  }, `hover-${id}`);
  await page.mouse.move(at[0] + 2, at[1] + 1);
  const tip = () => figure.$eval(".tip", (e) => ({ text: e.textContent, on: getComputedStyle(e).visibility === "visible" }));
  const shown = await tip();
  check(`${name}/${id}: a value on hover`, shown.on && /\d/.test(shown.text), JSON.stringify(shown));
  await page.mouse.move(2, 2);
  const plot = await figure.$(".plot");
  await plot.focus();
  await page.keyboard.press("ArrowRight");
  const first = await tip();
  await page.keyboard.press("ArrowRight");
  const second = await tip();
  check(`${name}/${id}: values by key`, first.on && second.on && first.text.length > 0);
  const before = await svg.getAttribute("viewBox");
  await page.keyboard.press("+");
  check(`${name}/${id}: zooms`, (await svg.getAttribute("viewBox")) !== before);
  await page.keyboard.press("0");
  check(`${name}/${id}: zooms back`, (await svg.getAttribute("viewBox")).split(" ").map(Number).join() === before.split(" ").map(Number).join());
}

async function replay(page, name) {
  const host = await page.$(".replay");
  check(`${name}: has a replay`, Boolean(host));
  if (!host) return;
  await host.scrollIntoViewIfNeeded();
  const canvases = await host.$$("canvas");
  const state = () => canvases[0].evaluate((c) => {
    const copy = document.createElement("canvas");
    [copy.width, copy.height] = [c.width, c.height];
    const context = copy.getContext("2d", { willReadFrequently: true });
    context.drawImage(c, 0, 0);
    const data = context.getImageData(0, 0, c.width, c.height).data;
    let sum = 0, painted = 0;
    for (let i = 0; i < data.length; i += 4) { sum = (sum * 31 + data[i] + data[i + 1] * 3 + data[i + 2] * 7) % 1000000007; if (data[i + 3] > 250) painted += 1; }
    return { time: Number(c.dataset.time), steps: Number(c.dataset.steps), sum, share: painted / (data.length / 4) };
  });
  const start = await state();
  check(`${name}: the robot is drawn`, start.share > 0.02, JSON.stringify(start));
  await host.$eval(".play", (b) => b.click());
  await page.waitForTimeout(1300);
  await host.$eval(".play", (b) => b.click());
  const played = await state();
  check(`${name}: replay advances`, played.time > 0.3 && played.sum !== start.sum, JSON.stringify([start, played]));
  await page.waitForTimeout(150);
  check(`${name}: replay pauses`, (await state()).time === played.time);
  await host.$eval("input[type=range]", (e) => { e.value = e.max; e.dispatchEvent(new Event("input", { bubbles: true })); });
  const sought = await state();
  check(`${name}: replay seeks and counts`, sought.time > 3 && sought.steps > played.steps, JSON.stringify(sought));
  await canvases[0].focus();
  await page.keyboard.press("ArrowRight");
  check(`${name}: view turns by key`, (await state()).sum !== sought.sum);
  await host.$eval("input[type=range]", (e) => { e.value = 3.2; e.dispatchEvent(new Event("input", { bubbles: true })); });
  await host.screenshot({ path: path.join(out, `${name}-replay.png`) });
}

(async () => {
  const browser = await chromium.launch({ executablePath: process.env.CHROMIUM, args: ["--no-sandbox"] });
  for (const file of process.argv.slice(2)) {
    const name = path.basename(file, ".html");
    const base = name === "report" ? path.basename(path.dirname(path.resolve(file))) : name;
    for (const [width, theme] of [[1400, "light"], [1400, "dark"], [400, "light"], [400, "dark"]]) {
      const label = `${base}-${width}-${theme}`;
      const context = await browser.newContext({ viewport: { width, height: width > 500 ? 900 : 800 }, colorScheme: theme, offline: true, isMobile: width < 500, hasTouch: width < 500 });
      const page = await context.newPage();
      const errors = [], requests = [];
      page.on("console", (m) => { if (m.type() === "error" || m.type() === "warning") errors.push(m.text()); });
      page.on("pageerror", (e) => errors.push(String(e)));
      page.on("request", (r) => { if (!r.url().startsWith("file:") && !r.url().startsWith("data:")) requests.push(r.url()); });
      await page.goto("file://" + path.resolve(file));
      await page.evaluate(() => document.fonts.ready);
      const list = await figures(page, label);
      if (width > 500) {
        for (const figure of theme === "light" ? list : list.slice(0, 1)) await hover(page, label, figure);
      }
      if (await page.$(".replay")) await replay(page, label);
      const overflow = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
      check(`${label}: no sideways scrolling`, overflow <= 1, `${overflow} px`);
      const ground = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
      check(`${label}: ground fits the theme`, (await ground()) === (theme === "dark" ? "rgb(20, 24, 29)" : "rgb(255, 255, 255)"), await ground());
      if (width > 500) {
        const was = await ground();
        await page.click("#theme");
        check(`${label}: the button changes the theme`, (await ground()) !== was);
        await page.click("#theme");
      }
      await page.evaluate(() => window.scrollTo(0, 0));
      await page.screenshot({ path: path.join(out, `${label}.png`), fullPage: true });
      check(`${label}: no console error`, errors.length === 0, errors.join(" | "));
      check(`${label}: no request leaves the file`, requests.length === 0, requests.join(" | "));
      await context.close();
    }
  }
  await browser.close();
  console.log(`${passed} passed, ${failed} failed`);
  process.exit(failed ? 1 : 0);
})().catch((error) => {
  console.error(error);
  process.exit(1);
});
