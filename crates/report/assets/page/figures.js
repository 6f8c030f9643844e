// Values under the pointer, keyboard and zoom for the inline figures.
"use strict";
(() => {
  for (const figure of document.querySelectorAll("figure[data-hover]")) {
    const source = document.getElementById(figure.dataset.hover);
    const svg = figure.querySelector("svg.sm");
    if (!source || !svg) continue;
    const points = JSON.parse(source.textContent);
    const plot = figure.querySelector(".plot");
    const tip = figure.querySelector(".tip");
    const dot = figure.querySelector(".dot");
    const full = svg.viewBox.baseVal;
    const home = [full.x, full.y, full.width, full.height];
    let box = home.slice();
    let at = -1;

    const scale = () => {
      const r = svg.getBoundingClientRect();
      return { r, s: Math.min(r.width / box[2], r.height / box[3]) };
    };
    const hide = () => { at = -1; tip.style.visibility = dot.style.visibility = "hidden"; };
    const show = (i) => {
      at = i;
      const { r, s } = scale();
      const p = plot.getBoundingClientRect();
      const x = r.left - p.left + (points[i][0] - box[0]) * s;
      const y = r.top - p.top + (points[i][1] - box[1]) * s;
      tip.textContent = points[i][2];
      tip.style.left = Math.max(90, Math.min(p.width - 90, x)) + "px";
      tip.style.top = y + "px";
      dot.style.left = x + "px";
      dot.style.top = y + "px";
      const inside = x >= 0 && x <= p.width && y >= 0 && y <= p.height + 1;
      tip.style.visibility = dot.style.visibility = inside ? "visible" : "hidden";
    };
    const nearest = (event) => {
      const { r, s } = scale();
      const x = (event.clientX - r.left) / s + box[0], y = (event.clientY - r.top) / s + box[1];
      let best = -1, reach = (26 / s) ** 2;
      points.forEach((q, i) => {
        const d = (q[0] - x) ** 2 + (q[1] - y) ** 2;
        if (d < reach) { reach = d; best = i; }
      });
      return best;
    };
    const zoom = (factor, cx, cy) => {
      const w = Math.min(home[2], Math.max(home[2] / 12, box[2] / factor));
      const h = w * home[3] / home[2];
      const fx = (cx - box[0]) / box[2], fy = (cy - box[1]) / box[3];
      move(cx - fx * w, cy - fy * h, w, h);
    };
    const move = (x, y, w, h) => {
      box = [Math.max(home[0], Math.min(home[0] + home[2] - w, x)), Math.max(home[1], Math.min(home[1] + home[3] - h, y)), w, h];
      svg.setAttribute("viewBox", box.join(" "));
      svg.classList.toggle("zoomed", w < home[2] - 1e-6);
      if (at >= 0) show(at);
    };
    const middle = (factor) => zoom(factor, box[0] + box[2] / 2, box[1] + box[3] / 2);
    const reset = () => { move(...home); hide(); };
    const pan = (dx, dy) => move(box[0] + dx * box[2], box[1] + dy * box[3], box[2], box[3]);

    let drag = null;
    svg.addEventListener("pointerdown", (e) => {
      if (svg.classList.contains("zoomed") && e.button === 0) {
        drag = [e.clientX, e.clientY, box[0], box[1]];
        svg.setPointerCapture(e.pointerId);
      }
      const i = nearest(e);
      if (i >= 0) show(i);
    });
    svg.addEventListener("pointermove", (e) => {
      if (drag) {
        const { s } = scale();
        move(drag[2] - (e.clientX - drag[0]) / s, drag[3] - (e.clientY - drag[1]) / s, box[2], box[3]);
        return;
      }
      const i = nearest(e);
      if (i >= 0) show(i); else hide();
    });
    svg.addEventListener("pointerup", () => { drag = null; });
    svg.addEventListener("pointerleave", () => { if (!drag) hide(); });
    svg.addEventListener("dblclick", (e) => {
      const { r, s } = scale();
      zoom(2, (e.clientX - r.left) / s + box[0], (e.clientY - r.top) / s + box[1]);
    });
    svg.addEventListener("wheel", (e) => {
      if (!e.ctrlKey && !e.metaKey) return;
      e.preventDefault();
      const { r, s } = scale();
      zoom(Math.exp(-e.deltaY / 300), (e.clientX - r.left) / s + box[0], (e.clientY - r.top) / s + box[1]);
    }, { passive: false });
    const keys = {
      "+": () => middle(1.5), "=": () => middle(1.5), "-": () => middle(1 / 1.5), "0": reset, Escape: reset,
      ArrowRight: (e) => (e.shiftKey ? pan(0.15, 0) : points.length && show((at + 1) % points.length)),
      ArrowLeft: (e) => (e.shiftKey ? pan(-0.15, 0) : points.length && show((at + points.length - (at < 0 ? 0 : 1)) % points.length)),
      ArrowUp: (e) => e.shiftKey && pan(0, -0.15),
      ArrowDown: (e) => e.shiftKey && pan(0, 0.15),
    };
    plot.addEventListener("keydown", (e) => {
      const act = keys[e.key];
      if (!act || e.target.tagName === "BUTTON" || (e.key.startsWith("ArrowU") || e.key.startsWith("ArrowD")) && !e.shiftKey) return;
      e.preventDefault();
      act(e);
    });
    plot.addEventListener("blur", hide);
    figure.querySelector(".in").addEventListener("click", () => middle(1.5));
    figure.querySelector(".out").addEventListener("click", () => middle(1 / 1.5));
    figure.querySelector(".home").addEventListener("click", reset);
  }

  const root = document.documentElement;
  const toggle = document.getElementById("theme");
  const dark = () => (root.dataset.theme || (matchMedia("(prefers-color-scheme:dark)").matches ? "dark" : "light")) === "dark";
  const label = () => { toggle.textContent = dark() ? "Light" : "Dark"; };
  toggle.addEventListener("click", () => {
    root.dataset.theme = dark() ? "light" : "dark";
    label();
    window.dispatchEvent(new Event("themechange"));
  });
  matchMedia("(prefers-color-scheme:dark)").addEventListener("change", () => { label(); window.dispatchEvent(new Event("themechange")); });
  label();
})();
