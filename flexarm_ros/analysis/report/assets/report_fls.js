// The fuzzy logic system: membership functions as curves, lambda as a surface that turns.
const SCALE = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];

function scaleColor(part) {
  const place = Math.min(1, Math.max(0, part)) * (SCALE.length - 1), i = Math.min(SCALE.length - 2, Math.floor(place));
  const mix = SCALE[i].map((from, k) => Math.round(from + (SCALE[i + 1][k] - from) * (place - i)));
  return `rgb(${mix.join(",")})`;
}

function drawSets(parent, sets, scale, xLabel, label) {
  const box = html("div", null, parent, "chart");
  const draw = (w) => {
    const h = Math.round(Math.max(190, w * 0.42));
    box.replaceChildren();
    const node = svg("svg", { viewBox: `0 0 ${w} ${h}`, role: "img", "aria-label": label }, box);
    const low = Math.min(...sets.map((s) => s.feet[0])), high = Math.max(...sets.map((s) => s.feet[2]));
    const x = (value) => 44 + (value - low) / (high - low) * (w - 44 - 34), y = (value) => h - 40 - value * (h - 40 - 30);
    for (const value of ticks(low * scale, high * scale, 6).values) {
      svg("line", { class: "grid", x1: x(value / scale), x2: x(value / scale), y1: y(0), y2: y(1) }, node);
      svg("text", { x: x(value / scale), y: h - 24, "text-anchor": "middle" }, node).textContent = tickText(value, (high - low) * scale / 10);
    }
    for (const value of [0, 0.5, 1]) {
      svg("line", { class: "grid", x1: x(low), x2: x(high), y1: y(value), y2: y(value) }, node);
      svg("text", { x: 36, y: y(value) + 4, "text-anchor": "end" }, node).textContent = value;
    }
    svg("text", { x: x(high), y: h - 8, "text-anchor": "end" }, node).textContent = xLabel;
    svg("text", { transform: `translate(12 ${y(0.5)}) rotate(-90)`, "text-anchor": "middle" }, node).textContent = "membership";
    sets.forEach((set, i) => {
      const [a, b, c] = set.feet;
      const d = `M${x(a)} ${y(a === b ? 1 : 0)}L${x(b)} ${y(1)}L${x(c)} ${y(c === b ? 1 : 0)}`;
      svg("path", { d, class: "series", stroke: `var(--${["green", "purple", "amber"][i % 3]})`, "stroke-dasharray": ["", "7 4", "9 3 2 3"][i % 3], "stroke-width": 1.8 }, node);
      svg("text", { x: x(b), y: 20, "text-anchor": "middle", class: "title" }, node).textContent = set.name;
    });
  };
  follow(box, draw, 340);
}

class Surface {
  constructor(parent, fls, runs) {
    Object.assign(this, { fls, runs, turn: -0.6, tilt: 0.6, grid: 0, width: 0 });
    this.box = html("div", null, parent, "chart surface");
    this.box.tabIndex = 0;
    this.box.setAttribute("role", "group");
    this.box.setAttribute("aria-label", "Surface of lambda over both deflections. Arrow keys or a drag turn it.");
    this.box.addEventListener("keydown", (event) => this.key(event));
    let from = null;
    this.box.addEventListener("pointerdown", (event) => { from = event; this.box.setPointerCapture(event.pointerId); });
    this.box.addEventListener("pointermove", (event) => {
      if (!from) return;
      this.rotate((event.clientX - from.clientX) * 0.01, (event.clientY - from.clientY) * 0.01);
      from = event;
    });
    for (const name of ["pointerup", "pointercancel"]) this.box.addEventListener(name, () => { from = null; });
    follow(this.box, (width) => { this.width = width; this.draw(); }, 490);
  }

  key(event) {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    this.rotate(step[0], step[1]);
  }

  rotate(turn, tilt) {
    this.turn += turn;
    this.tilt = Math.min(1.5, Math.max(0.05, this.tilt + tilt));
    this.draw();
  }

  project(a, b, z) {
    const cos = Math.cos(this.turn), sin = Math.sin(this.turn);
    const x = a * cos - b * sin, depth = a * sin + b * cos;
    return { x: this.width / 2 + x * this.size, y: this.middle + depth * Math.sin(this.tilt) * this.size - (z - 0.4) * Math.cos(this.tilt) * this.size * 1.2, depth };
  }

  draw() {
    if (!this.width) return;
    const { reach, values } = this.fls.grids[this.grid], n = values.length, h = Math.round(Math.min(430, this.width * 0.8));
    this.size = Math.min(this.width * 0.3, h * 0.37);
    this.middle = h * 0.53;
    const low = Math.min(...values.map((row) => Math.min(...row))), high = Math.max(...values.map((row) => Math.max(...row)));
    const [bottom, top] = this.grid === 0 ? [0, 1] : [low, high];
    const height = (value) => (value - bottom) / (top - bottom);
    const node = svg("svg", { viewBox: `0 0 ${this.width} ${h}`, role: "img", "aria-label": "Surface of lambda" });
    this.floor(node, reach, bottom, top);
    this.faces(node, values, n, height, (value) => scaleColor((value - low) / (high - low)));
    for (const run of this.runs) if (run.shown && run.law === "FLS") this.track(node, run, reach, height);
    svg("text", { x: 8, y: 18 }, node).textContent = `λ from ${low.toFixed(3)} (dark) to ${high.toFixed(3)} (light)`;
    this.box.replaceChildren(node);
  }

  // The faces of the surface, the furthest first.
  faces(node, values, n, height, color) {
    const faces = [], unit = (i) => -1 + 2 * i / (n - 1);
    for (let i = 0; i + 1 < n; i++) for (let j = 0; j + 1 < n; j++) {
      const corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(([a, b]) => this.project(unit(b), -unit(a), height(values[a][b])));
      const mean = (values[i][j] + values[i + 1][j] + values[i + 1][j + 1] + values[i][j + 1]) / 4;
      faces.push({ corners, mean, depth: corners.reduce((sum, c) => sum + c.depth, 0) });
    }
    faces.sort((a, b) => a.depth - b.depth);
    for (const { corners, mean } of faces) svg("path", { class: "face", d: "M" + corners.map((c) => c.x.toFixed(1) + " " + c.y.toFixed(1)).join("L") + "Z", fill: color(mean) }, node);
  }

  // Where a run's deflections took it.
  track(node, run, reach, height) {
    const c = run.c, parts = [];
    let pen = false;
    for (let i = 0; i < c.t.length; i++) {
      const a = c.delta1[i] / reach, b = c.delta2[i] / reach, z = height(c.lambda[i]);
      if (!(Math.abs(a) <= 1 && Math.abs(b) <= 1 && isFinite(z))) { pen = false; continue; }
      const p = this.project(a, -b, z);
      parts.push((pen ? "L" : "M") + p.x.toFixed(1) + " " + p.y.toFixed(1));
      pen = true;
    }
    if (parts.length) svg("path", { d: parts.join(""), class: "series", stroke: hue(run), "stroke-width": 1 }, node);
  }

  // The ground, with the axes along its two nearer edges and lambda's at its leftmost corner.
  floor(node, reach, bottom, top) {
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => ({ a, b, ...this.project(a, b, 0) }));
    svg("path", { class: "axis", d: "M" + corners.map((c) => c.x.toFixed(1) + " " + c.y.toFixed(1)).join("L") + "Z" }, node);
    const near = corners.reduce((best, c) => (c.depth > best.depth ? c : best));
    for (const c of corners) {
      if ((c.a === near.a) === (c.b === near.b)) continue;
      const name = c.a === near.a ? "δ₂" : "δ₁", x = Math.min(this.width - 50, Math.max(50, (c.x + near.x) / 2));
      svg("text", { x, y: (c.y + near.y) / 2 + 20, "text-anchor": "middle" }, node).textContent = `${name}, ±${reach} m`;
    }
    const left = corners.reduce((best, c) => (c.x < best.x ? c : best));
    const up = this.project(left.a, left.b, 1);
    svg("line", { class: "axis", x1: left.x, y1: left.y, x2: up.x, y2: up.y }, node);
    for (const part of [0, 0.5, 1]) {
      const p = this.project(left.a, left.b, part), value = bottom + part * (top - bottom);
      svg("text", { x: p.x - 6, y: p.y + 4, "text-anchor": "end" }, node).textContent = this.grid === 0 ? value : value.toFixed(3);
    }
    svg("text", { x: up.x - 6, y: up.y - 12, "text-anchor": "end" }, node).textContent = "λ";
  }
}
