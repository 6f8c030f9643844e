// Reports in a browser: no console error, figures present and not empty, values on hover and by key,
// zoom, replay that plays and seeks, light and dark, phone and desk, no request leaves the file.
"use strict";
const path = require("node:path");
const { chromium } = require("playwright-core");

const out = process.env.OUT;
// Figures that a page must have, by the name of the run.
const single = ["learning", "state", "actions", "policy", "map", "map-slices", "map-lines", "predicted", "residuals", "return-map"];
const expected = {
  stepping: [...single, "push-1", "fig10"].map((f) => `r0-${f}`),
  walking: single.map((f) => `r0-${f}`),
  fall: ["learning", "state", "actions"].map((f) => `r0-${f}`),
  killed: ["learning", "state", "actions"].map((f) => `r0-${f}`),
  one: ["learning", "state", "actions"].map((f) => `r0-${f}`),
  "stepping-seeds-1-to-3": ["all-runs", "r0-learning", "r1-learning", "r2-learning"],
  beside: ["all-runs", "r0-learning", "r1-learning"],
};
// What a page must say in words.
const says = {
  stepping: /did not fall while learning/,
  walking: /The guard warned|did not fall while learning/,
  fall: /The robot fell .* while learning: stride \d+/,
  killed: /did not reach its end/,
  one: /This run has one stride/,
  "stepping-seeds-1-to-3": /Thick line: median over the runs; band: lower to upper quartile/,
  beside: /did not reach its end/,
};
let passed = 0, failed = 0;
const check = (what, ok, detail = "") => {
  if (ok) { passed += 1; return; }
  failed += 1;
  console.log(`FAILED ${what} ${detail}`);
};

async function figures(page, name, base) {
  const list = await page.$$("figure[data-hover]");
  check(`${name}: has figures`, list.length > 0);
  const ids = await page.$$eval("figure[data-hover]", (all) => all.map((f) => f.id));
  for (const id of expected[base] || []) check(`${name}: has the figure ${id}`, ids.includes(id), ids.join());
  if (says[base]) check(`${name}: says what happened`, says[base].test(await page.evaluate(() => document.body.innerText)));
  const source = await page.content();
  const outside = [...source.matchAll(/(?:src|href)="([^"#][^"]*)"/g)].map((m) => m[1]).filter((to) => !to.startsWith("https://doi.org/"));
  check(`${name}: nothing but a doi leaves the file`, outside.length === 0, outside.join());
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
    // No label runs out of its figure, and no two labels of ticks or axes lie on each other.
    const trouble = await svg.evaluate((e) => {
      const v = e.viewBox.baseVal, bad = [], s = e.getBoundingClientRect();
      const scale = v.width / s.width;
      const boxes = [...e.querySelectorAll("text")].map((t) => {
        const b = t.getBoundingClientRect();
        return { text: t.textContent, x0: (b.left - s.left) * scale, x1: (b.right - s.left) * scale, y0: (b.top - s.top) * scale, y1: (b.bottom - s.top) * scale };
      });
      for (const b of boxes) if (b.x0 < -1 || b.x1 > v.width + 1 || b.y0 < -1 || b.y1 > v.height + 1) bad.push(`"${b.text}" runs out`);
      boxes.forEach((a, i) => boxes.slice(i + 1).forEach((b) => {
        const w = Math.min(a.x1, b.x1) - Math.max(a.x0, b.x0), h = Math.min(a.y1, b.y1) - Math.max(a.y0, b.y0);
        if (w > 2 && h > 4.5) bad.push(`"${a.text}" lies on "${b.text}"`);
      }));
      return bad;
    });
    check(`${name}/${id}: labels have room`, trouble.length === 0, trouble.slice(0, 4).join("; "));
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

async function replay(page, name, host, pushed) {
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
  await page.waitForTimeout(900);
  await host.$eval(".play", (b) => b.click());
  const played = await state();
  check(`${name}: replay advances`, played.time > 0.1 && played.sum !== start.sum, JSON.stringify([start, played]));
  await page.waitForTimeout(150);
  check(`${name}: replay pauses`, (await state()).time === played.time);
  await host.$eval("input[type=range]", (e) => { e.value = e.max; e.dispatchEvent(new Event("input", { bubbles: true })); });
  const sought = await state();
  check(`${name}: replay seeks and counts`, sought.time > 3 && sought.steps > start.steps, JSON.stringify(sought));
  await canvases[0].focus();
  await page.keyboard.press("ArrowRight");
  check(`${name}: view turns by key`, (await state()).sum !== sought.sum);
  const seek = (time) => host.$eval("input[type=range]", (e, t) => { e.value = t; e.dispatchEvent(new Event("input", { bubbles: true })); }, time);
  // The colour of the arrow is on the canvas while the robot is pushed, and nowhere else.
  if (pushed) {
    const at = await page.evaluate((i) => {
      const r = window.stridemapReplays[i].views[0].rec;
      return (r.pushes[2] || r.pushes[0])[0] * r.period;
    }, pushed);
    await seek(at);
    const arrow = await canvases[0].evaluate((c) => {
      const css = getComputedStyle(document.documentElement).getPropertyValue("--c3").trim();
      const want = [1, 3, 5].map((i) => parseInt(css.slice(i, i + 2), 16));
      const data = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
      let n = 0;
      for (let i = 0; i < data.length; i += 4) if (Math.abs(data[i] - want[0]) + Math.abs(data[i + 1] - want[1]) + Math.abs(data[i + 2] - want[2]) < 6) n += 1;
      return n;
    });
    check(`${name}: pushes are arrows`, arrow > 200, `${arrow} pixels`);
  } else {
    await seek(3.2);
  }
  await host.screenshot({ path: path.join(out, `${name}-replay.png`) });
}

(async () => {
  const browser = await chromium.launch({ executablePath: process.env.CHROMIUM, args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"] });
  for (const file of process.argv.slice(2)) {
    const name = path.basename(file, ".html");
    const base = name === "report" ? path.basename(path.dirname(path.resolve(file))) : name;
    // The two tasks in every combination; the others once on a desk and once on a phone.
    const all = [[1400, "light"], [1400, "dark"], [400, "light"], [400, "dark"]];
    for (const [width, theme] of ["stepping", "walking"].includes(base) || !expected[base] ? all : [all[0], all[3]]) {
      const label = `${base}-${width}-${theme}`;
      const context = await browser.newContext({ viewport: { width, height: width > 500 ? 900 : 800 }, colorScheme: theme, offline: true, isMobile: width < 500, hasTouch: width < 500 });
      const page = await context.newPage();
      const errors = [], requests = [];
      page.on("console", (m) => { if (m.type() === "error" || m.type() === "warning") errors.push(m.text()); });
      page.on("pageerror", (e) => errors.push(String(e)));
      page.on("request", (r) => { if (!r.url().startsWith("file:") && !r.url().startsWith("data:")) requests.push(r.url()); });
      await page.goto("file://" + path.resolve(file));
      await page.evaluate(() => document.fonts.ready);
      const list = await figures(page, label, base);
      if (width > 500) {
        for (const figure of theme === "light" ? list : list.slice(0, 1)) await hover(page, label, figure);
      }
      const hosts = await page.$$(".replay");
      if (["stepping", "walking", "fall", "killed"].includes(base)) check(`${label}: has a replay`, hosts.length > 0);
      if (base === "stepping") check(`${label}: has a replay under pushes`, hosts.length === 2);
      for (const [i, host] of hosts.slice(0, 2).entries()) {
        const pushed = /push/.test(await host.getAttribute("data-poses"));
        if (i === 0 || pushed) await replay(page, pushed ? `${label}-push` : label, host, pushed && i);
      }
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
      if (width > 500 && theme === "light") {
        const size = require("node:fs").statSync(file).size;
        check(`${label}: under 6 MB`, size < 6e6, `${size} bytes`);
        check(`${label}: figures in the source`, (require("node:fs").readFileSync(file, "utf8").match(/<svg/g) || []).length >= (base === "one" ? 3 : 5));
        await page.emulateMedia({ media: "print" });
        const hidden = await page.evaluate(() => [...document.querySelectorAll("nav, .tools, .bar")].every((e) => getComputedStyle(e).display === "none"));
        check(`${label}: prints without controls`, hidden);
        await page.pdf({ path: path.join(out, `${base}.pdf`), format: "A4" });
        await page.emulateMedia({ media: "screen" });
      }
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
