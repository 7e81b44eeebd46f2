// One picture with axes: zoom by drag, buttons and keys, a cursor, a box of values.
let charts = 0;

class Chart {
  // options: label, xLabel, yLabel, curves() -> [{run, x, y, className}], equal, height(width),
  // marks (x of dotted lines), alsoShown() -> [{x, y}] (points that the whole must hold), overlay(chart, group), onSeek(x, y), onView(view), values(x, y)
  constructor(parent, options) {
    Object.assign(this, { options, view: null, width: 0, overlayGroup: null, drag: null });
    this.id = "chart" + ++charts;
    this.box = parent.classList.contains("chart") ? parent : html("div", null, parent, "chart");
    this.box.tabIndex = 0;
    this.box.setAttribute("role", "group");
    this.box.setAttribute("aria-label", options.label + ". Arrow keys step through time, plus and minus zoom, 0 shows all.");
    this.svg = svg("svg", { role: "img", "aria-label": options.label }, this.box);
    this.tip = html("div", null, this.box, "tip-box");
    this.tip.hidden = true;
    this.listen();
    follow(this.box, (width) => { this.width = width; this.draw(); }, options.paperWidth);
  }

  // Extent of what is shown, limited in x to the view's where only the height is to be fitted.
  extent(fitted) {
    let x0 = Infinity, x1 = -Infinity, y0 = Infinity, y1 = -Infinity;
    const more = this.options.alsoShown ? this.options.alsoShown() : [];
    for (const { x, y } of [...this.options.curves(), ...more]) {
      for (let i = 0; i < x.length; i++) {
        if (fitted && (x[i] < fitted.x0 || x[i] > fitted.x1)) continue;
        if (x[i] < x0) x0 = x[i];
        if (x[i] > x1) x1 = x[i];
        if (y[i] < y0) y0 = y[i];
        if (y[i] > y1) y1 = y[i];
      }
    }
    if (!(x1 >= x0)) { x0 = 0; x1 = 1; }
    if (!(y1 >= y0)) { y0 = 0; y1 = 1; }
    return { x0, x1, y0, y1 };
  }

  current() {
    const equal = this.options.equal, pad = (a, b, part) => (b > a ? (b - a) * part : Math.max(equal ? 1 : 1e-6, Math.abs(a) * 0.05));
    let v;
    if (this.view) v = Object.assign({}, this.view);
    else {
      v = this.extent();
      const px = equal ? pad(v.x0, v.x1, 0.04) : v.x1 > v.x0 ? 0 : 0.5;
      v.x0 -= px; v.x1 += px;
      if (equal) { const py = pad(v.y0, v.y1, 0.04); v.y0 -= py; v.y1 += py; }
    }
    if (!equal) {
      const e = this.extent(v), py = pad(e.y0, e.y1, 0.06);
      v.y0 = e.y0 - py; v.y1 = e.y1 + py;
    } else {
      const scale = Math.max((v.x1 - v.x0) / this.plot.w, (v.y1 - v.y0) / this.plot.h);
      const cx = (v.x0 + v.x1) / 2, cy = (v.y0 + v.y1) / 2;
      v = { x0: cx - scale * this.plot.w / 2, x1: cx + scale * this.plot.w / 2, y0: cy - scale * this.plot.h / 2, y1: cy + scale * this.plot.h / 2 };
    }
    return v;
  }

  px(x) { return this.plot.x + (x - this.v.x0) / (this.v.x1 - this.v.x0) * this.plot.w; }
  py(y) { return this.plot.y + this.plot.h - (y - this.v.y0) / (this.v.y1 - this.v.y0) * this.plot.h; }
  ux(p) { return this.v.x0 + (p - this.plot.x) / this.plot.w * (this.v.x1 - this.v.x0); }
  uy(p) { return this.v.y0 + (this.plot.y + this.plot.h - p) / this.plot.h * (this.v.y1 - this.v.y0); }

  draw() {
    if (!this.width) return;
    const o = this.options, w = this.width, h = Math.round(o.height(w)), narrow = w < 480;
    this.plot = { x: narrow ? 52 : 64, y: 26, w: w - (narrow ? 60 : 76), h: h - 26 - 40 };
    this.v = this.current();
    this.svg.setAttribute("viewBox", `0 0 ${w} ${h}`);
    this.svg.replaceChildren();
    const clip = svg("clipPath", { id: this.id }, svg("defs", {}, this.svg));
    svg("rect", { x: this.plot.x, y: this.plot.y, width: this.plot.w, height: this.plot.h }, clip);
    this.axes();
    const body = svg("g", { "clip-path": `url(#${this.id})` }, this.svg);
    for (const x of o.marks ? o.marks() : []) svg("line", { class: "switch", x1: this.px(x), x2: this.px(x), y1: this.plot.y, y2: this.plot.y + this.plot.h }, body);
    for (const curve of o.curves()) this.curve(curve, body);
    this.overlayGroup = svg("g", {}, body);
    this.selection = svg("rect", { class: "select", width: 0, height: 0 }, body);
    svg("rect", { class: "frame", x: this.plot.x, y: this.plot.y, width: this.plot.w, height: this.plot.h }, this.svg);
    this.overlay();
  }

  axes() {
    const { x, y, w, h } = this.plot, v = this.v, o = this.options;
    const xs = ticks(v.x0, v.x1, w / 75), ys = ticks(v.y0, v.y1, h / 30);
    for (const value of xs.values) {
      svg("line", { class: "grid", x1: this.px(value), x2: this.px(value), y1: y, y2: y + h }, this.svg);
      svg("text", { x: this.px(value), y: y + h + 16, "text-anchor": "middle" }, this.svg).textContent = tickText(value, xs.step);
    }
    for (const value of ys.values) {
      svg("line", { class: "grid", x1: x, x2: x + w, y1: this.py(value), y2: this.py(value) }, this.svg);
      svg("text", { x: x - 6, y: this.py(value) + 4, "text-anchor": "end" }, this.svg).textContent = tickText(value, ys.step);
    }
    svg("text", { x: x, y: 16, class: "title" }, this.svg).textContent = o.yLabel;
    svg("text", { x: x + w, y: y + h + 33, "text-anchor": "end" }, this.svg).textContent = o.xLabel;
  }

  curve(curve, parent) {
    const d = this.options.equal ? this.trace(curve) : this.envelope(curve);
    if (!d) return;
    const classes = ["series", curve.className || ""].join(" "), stroke = curve.className === "reference" ? null : hue(curve.run);
    const dash = curve.dash !== undefined ? curve.dash : curve.run.dash;
    svg("path", { d, class: classes, ...(stroke && { stroke }), "stroke-dasharray": dash, "stroke-width": curve.width || curve.run.width }, parent);
  }

  // A path point by point; points that fall on the one before are left out.
  trace({ x, y }) {
    const parts = [];
    let pen = false, lastX = NaN, lastY = NaN;
    for (let i = 0; i < x.length; i++) {
      if (!(isFinite(x[i]) && isFinite(y[i]))) { pen = false; continue; }
      const a = this.px(x[i]), b = this.py(y[i]);
      if (pen && Math.abs(a - lastX) < 0.4 && Math.abs(b - lastY) < 0.4 && i < x.length - 1) continue;
      parts.push((pen ? "L" : "M") + a.toFixed(1) + " " + b.toFixed(1));
      pen = true; lastX = a; lastY = b;
    }
    return x.length === 1 && parts.length ? parts[0] + "h1" : parts.join("");
  }

  // A function of time: of each column of pixels first, least, largest and last value.
  envelope({ x, y }) {
    const v = this.v, parts = [];
    let column = null, pen = false;
    const put = (i) => { parts.push((pen ? "L" : "M") + this.px(x[i]).toFixed(1) + " " + this.py(y[i]).toFixed(1)); pen = true; };
    const flush = () => {
      if (!column) return;
      const { first, least, most, last } = column;
      for (const i of [...new Set([first, Math.min(least, most), Math.max(least, most), last])]) put(i);
      column = null;
    };
    for (let i = 0; i < x.length; i++) {
      if ((i + 1 < x.length && x[i + 1] < v.x0) || (i > 0 && x[i - 1] > v.x1)) continue;
      if (!isFinite(y[i])) { flush(); pen = false; continue; }
      const place = Math.floor(this.px(x[i]));
      if (!column || column.place !== place) { flush(); column = { place, first: i, least: i, most: i, last: i }; }
      if (y[i] < y[column.least]) column.least = i;
      if (y[i] > y[column.most]) column.most = i;
      column.last = i;
    }
    flush();
    return x.length === 1 && parts.length ? parts[0] + "h1" : parts.join("");
  }

  overlay() {
    if (!this.overlayGroup) return;
    this.overlayGroup.replaceChildren();
    if (this.options.overlay) this.options.overlay(this, this.overlayGroup);
  }

  setView(view) {
    this.view = view;
    this.draw();
    if (this.options.onView) this.options.onView(view);
  }

  // Zooms by a factor about a point, x and y in the picture's units.
  zoom(factor, x, y) {
    const v = this.v, equal = this.options.equal;
    if (!v) return;
    x = Math.min(v.x1, Math.max(v.x0, x));
    const view = { x0: x + (v.x0 - x) * factor, x1: x + (v.x1 - x) * factor };
    if (equal) {
      y = Math.min(v.y1, Math.max(v.y0, y));
      view.y0 = y + (v.y0 - y) * factor; view.y1 = y + (v.y1 - y) * factor;
    } else if (factor > 1) {
      const e = this.extent();
      view.x0 = Math.max(e.x0, view.x0); view.x1 = Math.min(e.x1, view.x1);
      if (view.x0 <= e.x0 && view.x1 >= e.x1) return this.setView(null);
    }
    if (view.x1 - view.x0 > 1e-9 * Math.max(1, Math.abs(view.x0))) this.setView(view);
  }

  listen() {
    const at = (event) => {
      const r = this.svg.getBoundingClientRect(), k = this.width / r.width;
      return { x: (event.clientX - r.left) * k, y: (event.clientY - r.top) * k };
    };
    this.svg.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || !this.v) return;
      this.drag = at(event);
      this.svg.setPointerCapture(event.pointerId);
    });
    this.svg.addEventListener("pointermove", (event) => {
      if (!this.v) return;
      const p = at(event);
      if (this.drag) this.select(this.drag, p); else this.hover(p);
    });
    this.svg.addEventListener("pointerup", (event) => {
      if (!this.drag || !this.v) return;
      const from = this.drag, to = at(event);
      this.drag = null;
      this.selection.setAttribute("width", 0);
      if (Math.hypot(to.x - from.x, to.y - from.y) < 6) {
        if (this.options.onSeek) this.options.onSeek(this.ux(to.x), this.uy(to.y), this);
      } else this.zoomTo(from, to);
    });
    this.svg.addEventListener("pointercancel", () => { this.drag = null; this.selection.setAttribute("width", 0); });
    this.svg.addEventListener("pointerleave", () => { this.tip.hidden = true; });
    this.svg.addEventListener("dblclick", () => this.setView(null));
    this.svg.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      const p = at(event);
      this.zoom(event.deltaY > 0 ? 1.25 : 0.8, this.ux(p.x), this.uy(p.y));
    }, { passive: false });
  }

  select(a, b) {
    const equal = this.options.equal, { y, h } = this.plot;
    const box = { x: Math.min(a.x, b.x), y: equal ? Math.min(a.y, b.y) : y, width: Math.abs(a.x - b.x), height: equal ? Math.abs(a.y - b.y) : h };
    for (const key in box) this.selection.setAttribute(key, box[key]);
    this.tip.hidden = true;
  }

  zoomTo(a, b) {
    const view = { x0: this.ux(Math.min(a.x, b.x)), x1: this.ux(Math.max(a.x, b.x)) };
    if (this.options.equal) { view.y0 = this.uy(Math.max(a.y, b.y)); view.y1 = this.uy(Math.min(a.y, b.y)); }
    else { const e = this.extent(); view.x0 = Math.max(e.x0, view.x0); view.x1 = Math.min(e.x1, view.x1); }
    if (view.x1 > view.x0) this.setView(view);
  }

  hover(p) {
    const lines = this.options.values ? this.options.values(this.ux(p.x), this.uy(p.y), this) : null;
    const inside = p.x >= this.plot.x && p.x <= this.plot.x + this.plot.w && p.y >= this.plot.y && p.y <= this.plot.y + this.plot.h;
    this.tip.hidden = !lines || !inside;
    if (this.tip.hidden) return;
    this.tip.replaceChildren();
    for (const { run, text } of lines) {
      const row = html("div", null, this.tip);
      if (run) swatch(run, row);
      row.appendChild(document.createTextNode(text));
    }
    const k = this.svg.getBoundingClientRect().width / this.width;
    const left = p.x * k + 14, room = this.box.clientWidth - this.tip.offsetWidth - 4;
    this.tip.style.left = Math.max(0, left > room ? p.x * k - this.tip.offsetWidth - 14 : left) + "px";
    this.tip.style.top = Math.max(0, p.y * k - this.tip.offsetHeight - 8) + "px";
  }
}
