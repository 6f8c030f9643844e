// The robot moving: recorded poses drawn with the painter's algorithm on a plain 2-D canvas.
"use strict";
(() => {
  const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => { const n = Math.hypot(...a) || 1; return [a[0] / n, a[1] / n, a[2] / n]; };
  // Rotation matrix of a unit quaternion (w, x, y, z), row by row.
  const matrix = ([w, x, y, z]) => [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)];
  const turn = (m, v) => [
    m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2], m[6] * v[0] + m[7] * v[1] + m[8] * v[2]];

  // Corners and faces (anticlockwise seen from outside) of a shape in its own frame.
  const mesh = (kind) => {
    if (kind.type === "box") {
      const [a, b, c] = kind.half_extents_m, v = [];
      for (let i = 0; i < 8; i++) v.push([i & 1 ? a : -a, i & 2 ? b : -b, i & 4 ? c : -c]);
      return { v, f: [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] };
    }
    if (kind.type === "mesh") return { v: kind.vertices_m, f: kind.triangles.map(([a, b, c]) => [a, b, c, a]) };
    // Everything else is a stack of rings about z: [radius in x, radius in y, height].
    const rings = [], around = 18;
    if (kind.type === "cylinder") {
      const r = kind.radius_m, h = kind.half_length_m;
      rings.push([0, 0, -h], [r, r, -h], [r, r, h], [0, 0, h]);
    } else {
      const [a, b, c] = kind.type === "ellipsoid" ? kind.semi_axes_m : [kind.radius_m, kind.radius_m, kind.radius_m];
      const h = kind.type === "capsule" ? kind.half_length_m : 0, steps = 10;
      for (let i = 0; i <= steps; i++) {
        const t = -Math.PI / 2 + Math.PI * i / steps;
        const ring = (shift) => rings.push([a * Math.cos(t), b * Math.cos(t), c * Math.sin(t) + shift]);
        if (h && i === steps / 2) { ring(-h); ring(h); } else ring(i < steps / 2 ? -h : h);
      }
    }
    const v = [], f = [];
    rings.forEach(([a, b, z]) => {
      for (let i = 0; i < around; i++) {
        const t = 2 * Math.PI * i / around;
        v.push([a * Math.cos(t), b * Math.sin(t), z]);
      }
    });
    for (let k = 0; k + 1 < rings.length; k++) {
      for (let i = 0; i < around; i++) {
        const j = (i + 1) % around, p = k * around, q = p + around;
        f.push([p + i, p + j, q + j, q + i]);
      }
    }
    return { v, f };
  };

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;

  const unpack = (r) => {
    const rec = { ...r, root: new Float32Array(bytes(r.root)), place: new Int16Array(bytes(r.place)), turn: new Int16Array(bytes(r.turn)), cop: new Float32Array(bytes(r.cop)), loads: new Int16Array(bytes(r.loads)) };
    rec.count = rec.root.length / 3;
    rec.span = Math.max(0, (rec.count - 1) * r.period);
    rec.shapes = r.shapes.map((s) => {
      const m = matrix(s.pose.orientation), g = mesh(s.kind);
      return { body: s.body, rgb: s.rgba.slice(0, 3), v: g.v.map((p) => add(turn(m, p), s.pose.position_m)), f: g.f };
    });
    let peak = 1;
    for (const l of rec.loads) peak = Math.max(peak, l);
    rec.peak = peak;
    // The feet: the two bodies that come lowest at any time (each foot is in the air at some time); the left
    // one has the larger y at first.
    const first = pose(rec, 0), low = new Map(), looks = Math.min(rec.count, 60);
    for (let i = 0; i < looks; i++) {
      const bodies = i ? pose(rec, rec.span * i / (looks - 1)) : first;
      for (const s of rec.shapes) {
        const b = bodies[s.body];
        for (const p of s.v) {
          const q = add(turn(b.m, p), b.p);
          if (!low.has(s.body) || q[2] < low.get(s.body)) low.set(s.body, q[2]);
        }
      }
    }
    const feet = [...low].sort((a, b) => a[1] - b[1]).slice(0, 2).map((e) => e[0]);
    feet.sort((a, b) => first[b].p[1] - first[a].p[1]);
    rec.feet = feet;
    // The torso is the largest piece; pushes act there.
    const volume = (s) => [0, 1, 2].reduce((v, c) => v * (Math.max(...s.v.map((p) => p[c])) - Math.min(...s.v.map((p) => p[c]))), 1);
    rec.torso = rec.shapes.reduce((best, s, i) => (volume(s) > volume(rec.shapes[best]) ? i : best), 0);
    return rec;
  };

  // Every body's position and rotation at a time since the first frame, between frames by interpolation.
  function pose(rec, time) {
    const at = Math.max(0, Math.min(rec.count - 1, rec.period > 0 ? time / rec.period : 0));
    const i = Math.min(Math.floor(at), Math.max(0, rec.count - 2)), j = Math.min(i + 1, rec.count - 1), t = at - i;
    const mix = (a, b) => a + t * (b - a), out = [], n = rec.bodies;
    const root = [0, 1, 2].map((c) => mix(rec.root[3 * i + c], rec.root[3 * j + c]));
    for (let b = 0; b < n; b++) {
      const p = [0, 1, 2].map((c) => root[c] + rec.scale * mix(rec.place[3 * (i * n + b) + c], rec.place[3 * (j * n + b) + c]));
      const qa = [0, 1, 2, 3].map((c) => rec.turn[4 * (i * n + b) + c]), qb = [0, 1, 2, 3].map((c) => rec.turn[4 * (j * n + b) + c]);
      const sign = qa.reduce((s, v, c) => s + v * qb[c], 0) < 0 ? -1 : 1;
      const q = qa.map((v, c) => mix(v, sign * qb[c])), len = Math.hypot(...q) || 1;
      out.push({ p, m: matrix(q.map((v) => v / len)) });
    }
    return out;
  }

  // Shapes are convex, so a shadow is the hull of its corners' shadows (Andrew's monotone chain).
  const hull = (points) => {
    const sorted = points.slice().sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const half = (list) => {
      const out = [];
      for (const p of list) {
        while (out.length > 1) {
          const a = out[out.length - 2], b = out[out.length - 1];
          if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
          out.pop();
        }
        out.push(p);
      }
      out.pop();
      return out;
    };
    return half(sorted).concat(half(sorted.reverse()));
  };

  const LIGHT = unit([0.45, -0.3, 1]);

  class View {
    constructor(host, rec) {
      this.canvas = host.querySelector("canvas");
      this.hud = host.querySelector(".hud");
      this.rec = rec;
      this.context = this.canvas.getContext("2d");
      this.home();
      this.listen();
    }
    home() { this.azimuth = 2.55; this.elevation = 0.2; this.zoom = 1; }
    listen() {
      const c = this.canvas;
      let from = null;
      c.addEventListener("pointerdown", (e) => { from = [e.clientX, e.clientY, this.azimuth, this.elevation]; c.setPointerCapture(e.pointerId); });
      c.addEventListener("pointermove", (e) => {
        if (!from) return;
        this.orbit(from[2] - (e.clientX - from[0]) * 0.008, from[3] + (e.clientY - from[1]) * 0.006);
      });
      c.addEventListener("pointerup", () => { from = null; });
      c.addEventListener("pointercancel", () => { from = null; });
      c.addEventListener("wheel", (e) => { if (e.ctrlKey || e.metaKey) { e.preventDefault(); this.closer(Math.exp(-e.deltaY / 400)); } }, { passive: false });
      c.addEventListener("keydown", (e) => {
        const act = { ArrowLeft: () => this.orbit(this.azimuth - 0.1, this.elevation), ArrowRight: () => this.orbit(this.azimuth + 0.1, this.elevation), ArrowUp: () => this.orbit(this.azimuth, this.elevation + 0.07), ArrowDown: () => this.orbit(this.azimuth, this.elevation - 0.07), "+": () => this.closer(1.15), "=": () => this.closer(1.15), "-": () => this.closer(1 / 1.15), "0": () => { this.home(); this.player.viewed(this); } }[e.key];
        if (act) { e.preventDefault(); act(); }
      });
    }
    orbit(azimuth, elevation) { this.azimuth = azimuth; this.elevation = Math.max(-0.05, Math.min(1.45, elevation)); this.player.viewed(this); }
    closer(factor) { this.zoom = Math.max(0.4, Math.min(5, this.zoom * factor)); this.player.viewed(this); }

    draw(time) {
      const { canvas, context: g, rec } = this, css = getComputedStyle(document.documentElement);
      const color = (name) => css.getPropertyValue("--" + name).trim();
      const ratio = Math.min(2, window.devicePixelRatio || 1), w = canvas.clientWidth, h = canvas.clientHeight;
      if (!w || !rec.count) return;
      if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) { canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio); }
      g.setTransform(ratio, 0, 0, ratio, 0, 0);
      g.clearRect(0, 0, w, h);
      const t = Math.min(time, rec.span), bodies = pose(rec, t), size = rec.size;
      const k = Math.max(0, Math.min(rec.count - 1, Math.round(t / (rec.period || 1))));
      // The camera goes with the torso: the first body may be the world.
      const centre = rec.shapes.length ? bodies[rec.shapes[rec.torso].body].p : bodies[0].p;
      const target = [centre[0], centre[1], 0.47 * size];
      const ca = Math.cos(this.azimuth), sa = Math.sin(this.azimuth), ce = Math.cos(this.elevation), se = Math.sin(this.elevation);
      const far = 3.1 * size / this.zoom;
      const eye = add(target, [-far * ca * ce, -far * sa * ce, far * se]);
      const forward = unit(sub(target, eye)), right = unit(cross(forward, [0, 0, 1])), up = cross(right, forward);
      const focal = 2.35 * Math.min(w, h * 0.92);
      const project = (p) => { const d = sub(p, eye), z = Math.max(0.05, dot(d, forward)); return [w / 2 + focal * dot(d, right) / z, h / 2 - focal * dot(d, up) / z, z]; };

      this.floor(g, project, target, size, color);
      const world = rec.shapes.map((s) => s.v.map((p) => add(turn(bodies[s.body].m, p), bodies[s.body].p)));
      // Shadows as one path, so that overlaps do not darken.
      g.beginPath();
      for (const v of world) {
        const flat = v.map((p) => { const q = Math.max(0, p[2]); return project([p[0] - LIGHT[0] / LIGHT[2] * q, p[1] - LIGHT[1] / LIGHT[2] * q, 0]); });
        hull(flat).forEach((p, m) => (m ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])));
        g.closePath();
      }
      g.fillStyle = "rgba(0,0,0,.18)";
      g.fill("nonzero");

      const cop = [rec.cop[2 * k], rec.cop[2 * k + 1]], loads = [rec.loads[2 * k], rec.loads[2 * k + 1]];
      const down = loads.map((l) => l > 0.03 * rec.peak), contact = hex(color("c2"));
      const faces = [];
      world.forEach((v, i) => {
        const s = rec.shapes[i], foot = rec.feet.indexOf(s.body);
        const base = foot >= 0 && down[foot] ? contact : s.rgb;
        for (const f of s.f) {
          const a = v[f[0]], n0 = cross(sub(v[f[2]], a), sub(v[f[3]], v[f[1]])), len = Math.hypot(...n0);
          if (len < 1e-12) continue;
          const n = [n0[0] / len, n0[1] / len, n0[2] / len];
          const mid = [0, 1, 2].map((c) => (v[f[0]][c] + v[f[1]][c] + v[f[2]][c] + v[f[3]][c]) / 4);
          const view = sub(eye, mid);
          if (dot(n, view) <= 0) continue;
          const light = 0.48 + 0.36 * Math.max(0, dot(n, LIGHT)) + 0.28 * Math.max(0, dot(n, unit(view)));
          faces.push([dot(view, view), f.map((m) => project(v[m])), "rgb(" + base.map((c) => Math.round(255 * Math.min(1, c * light * 1.12))).join() + ")"]);
        }
      });
      faces.sort((a, b) => b[0] - a[0]);
      g.lineJoin = "round";
      for (const [, ring, fill] of faces) {
        g.beginPath();
        ring.forEach((p, m) => (m ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])));
        g.closePath();
        g.fillStyle = g.strokeStyle = fill;
        g.lineWidth = 0.7;
        g.fill();
        g.stroke();
      }
      if (Number.isFinite(cop[0])) {
        const p = project([cop[0], cop[1], 0]);
        g.beginPath();
        g.arc(p[0], p[1], 6, 0, 7);
        g.fillStyle = color("c1");
        g.fill();
        g.lineWidth = 2;
        g.strokeStyle = color("bg");
        g.stroke();
      }
      const push = rec.pushes.find((q) => q[0] === k);
      if (push && world.length) {
        const v = world[rec.torso], middle = [0, 1, 2].map((c) => v.reduce((s, p) => s + p[c], 0) / v.length);
        this.arrow(g, project, middle, push.slice(1), size, color);
      }
      let steps = 0;
      for (const c of rec.crossings) if (c <= k) steps++;
      canvas.dataset.time = t.toFixed(3);
      canvas.dataset.steps = steps;
      this.hud.textContent = `${t.toFixed(2)} s\n${steps} ${steps === 1 ? "step" : "steps"}\nleft ${loads[0]} N\nright ${loads[1]} N`;
    }
    floor(g, project, target, size, color) {
      const cell = 0.125 * Math.pow(2, Math.round(Math.log2(size / 0.8))), n = 12;
      const x0 = Math.round(target[0] / cell), y0 = Math.round(target[1] / cell);
      g.strokeStyle = color("axis");
      g.lineWidth = 1;
      for (let i = -n; i <= n; i++) {
        for (const along of [0, 1]) {
          for (let j = -n; j < n; j++) {
            const fade = 1 - Math.hypot(i, j + 0.5) / n;
            if (fade <= 0) continue;
            const point = (m) => project(along ? [(x0 + i) * cell, (y0 + m) * cell, 0] : [(x0 + m) * cell, (y0 + i) * cell, 0]);
            const a = point(j), b = point(j + 1);
            g.globalAlpha = 0.5 * fade;
            g.beginPath();
            g.moveTo(a[0], a[1]);
            g.lineTo(b[0], b[1]);
            g.stroke();
          }
        }
      }
      g.globalAlpha = 1;
    }
    arrow(g, project, at, force, size, color) {
      const n = Math.hypot(...force) || 1, length = size * (0.16 + 0.2 * Math.min(1, n / 60));
      const dir = force.map((f) => f / n);
      // The arrow ends at the body: it shows who is pushed, and whereto.
      const a = project(sub(at, dir.map((d) => d * (length + 0.12 * size)))), b = project(sub(at, dir.map((d) => d * 0.12 * size)));
      const angle = Math.atan2(b[1] - a[1], b[0] - a[0]);
      g.strokeStyle = g.fillStyle = color("c3");
      g.lineWidth = 5;
      g.beginPath();
      g.moveTo(a[0], a[1]);
      g.lineTo(b[0] - 10 * Math.cos(angle), b[1] - 10 * Math.sin(angle));
      g.stroke();
      g.beginPath();
      g.moveTo(b[0], b[1]);
      for (const turnBy of [2.7, -2.7]) g.lineTo(b[0] + 18 * Math.cos(angle + turnBy), b[1] + 18 * Math.sin(angle + turnBy));
      g.closePath();
      g.fill();
      g.font = "600 14px Inter, sans-serif";
      g.textAlign = "center";
      g.fillText(Math.round(n) + " N", (a[0] + b[0]) / 2, Math.min(a[1], b[1]) - 12);
    }
  }
  const hex = (c) => [1, 3, 5].map((i) => parseInt(c.slice(i, i + 2), 16) / 255);

  class Player {
    constructor(host) {
      const recordings = JSON.parse(document.getElementById(host.dataset.poses).textContent).map(unpack);
      this.views = [...host.querySelectorAll(".view")].map((v, i) => new View(v, recordings[i]));
      this.views.forEach((v) => { v.player = this; });
      this.span = Math.max(...recordings.map((r) => r.span));
      this.time = 0;
      this.speed = 1;
      this.playing = false;
      this.button = host.querySelector(".play");
      this.scrub = host.querySelector("input[type=range]");
      this.out = host.querySelector("output");
      this.scrub.max = this.span;
      this.button.addEventListener("click", () => this.play(!this.playing));
      this.scrub.addEventListener("input", () => this.seek(Number(this.scrub.value)));
      host.querySelector("select").addEventListener("change", (e) => { this.speed = Number(e.target.value); });
      host.querySelector(".reset").addEventListener("click", () => { this.views.forEach((v) => v.home()); this.draw(); });
      host.addEventListener("keydown", (e) => {
        if (e.key === " " && e.target.tagName === "CANVAS") { e.preventDefault(); this.play(!this.playing); }
      });
      window.addEventListener("resize", () => this.draw());
      window.addEventListener("themechange", () => this.draw());
      window.addEventListener("beforeprint", () => this.draw());
      this.draw();
    }
    // Both robots are seen from the same side.
    viewed(view) {
      for (const v of this.views) { v.azimuth = view.azimuth; v.elevation = view.elevation; v.zoom = view.zoom; }
      this.draw();
    }
    seek(time) { this.time = Math.max(0, Math.min(this.span, time)); this.draw(); }
    play(on) {
      this.playing = on;
      this.button.textContent = on ? "Pause" : "Play";
      if (!on) return;
      if (this.time >= this.span) this.time = 0;
      let last = null;
      const tick = (now) => {
        if (!this.playing) return;
        if (last !== null) this.time += this.speed * Math.min(0.1, (now - last) / 1000);
        last = now;
        if (this.time >= this.span) { this.time = this.span; this.play(false); }
        this.draw();
        if (this.playing) requestAnimationFrame(tick);
      };
      requestAnimationFrame(tick);
    }
    draw() {
      this.views.forEach((v) => v.draw(this.time));
      this.scrub.value = this.time;
      this.out.textContent = this.time.toFixed(2) + " s";
    }
  }
  window.stridemapReplays = [...document.querySelectorAll(".replay")].map((host) => new Player(host));
})();
