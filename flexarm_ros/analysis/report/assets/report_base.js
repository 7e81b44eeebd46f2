// Data, number formats and small helpers. Texts from files only ever become text nodes.
document.documentElement.dataset.script = "yes";
const SVG = "http://www.w3.org/2000/svg";
const byId = (id) => document.getElementById(id);

function svg(name, attributes, parent) {
  const node = document.createElementNS(SVG, name);
  for (const key in attributes) node.setAttribute(key, attributes[key]);
  if (parent) parent.appendChild(node);
  return node;
}

function html(name, text, parent, className) {
  const node = document.createElement(name);
  if (text !== undefined && text !== null) node.textContent = text;
  if (className) node.className = className;
  if (parent) parent.appendChild(node);
  return node;
}

// Unpacks base64 text of 24-bit codes: see pack() in report_data.py.
function unpack(entry, steps) {
  const octets = atob(entry.data);
  const values = new Float64Array(octets.length / 3);
  for (let i = 0, j = 0; i < values.length; i++, j += 3) {
    const code = octets.charCodeAt(j) | (octets.charCodeAt(j + 1) << 8) | (octets.charCodeAt(j + 2) << 16);
    values[i] = code > steps ? NaN : entry.low + (code / steps) * entry.span;
  }
  return values;
}

function loadRuns(data) {
  const pool = data.pool.map((entry) => unpack(entry, data.steps));
  return data.runs.map((run, index) => {
    const c = {};
    for (const name in run.columns) c[name] = pool[run.columns[name]];
    return Object.assign(run, { c, index, shown: true, end: c.t.length ? c.t[c.t.length - 1] : 0 });
  });
}

// Index of the last row at or before a time; 0 before the first.
function rowAt(run, time) {
  const t = run.c.t;
  let low = 0, high = t.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (t[middle] <= time + 1e-9) low = middle; else high = middle - 1;
  }
  return low;
}

function niceStep(span, count) {
  const raw = span / Math.max(1, count);
  const power = Math.pow(10, Math.floor(Math.log10(raw)));
  for (const factor of [1, 2, 5, 10]) if (raw <= factor * power * 1.0000001) return factor * power;
  return 10 * power;
}

function ticks(low, high, count) {
  const step = niceStep(high - low, count), result = [];
  if (!(step > 0) || !isFinite(step)) return { step: 1, values: [low] };
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9 && result.length < 60; k++) result.push(k * step);
  return { step, values: result };
}

function tickText(value, step) {
  const size = Math.max(Math.abs(value), step);
  if (size >= 1e5 || step < 1e-5) return (Math.abs(value) < step / 2 ? 0 : value).toExponential(Math.min(6, Math.max(0, Math.ceil(Math.log10(size / step) - 1e-9)))).replaceAll("-", "−").replace("e+", "e");
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return (Math.abs(value) < step / 2 ? 0 : value).toFixed(decimals).replace("-", "−");
}

// Four significant digits, a true minus sign, a dash for no value.
function show(value) {
  if (value === undefined || value === null || !isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e5 || size < 1e-4)) return value.toExponential(2).replaceAll("-", "−");
  return value.toFixed(size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : size >= 1 ? 3 : 4).replace("-", "−");
}

const hue = (run) => `var(--${run.color})`;

function swatch(run, parent) {
  const box = svg("svg", { class: "swatch", viewBox: "0 0 30 10", "aria-hidden": "true" }, parent);
  svg("line", { x1: 0, y1: 5, x2: 30, y2: 5, "stroke-width": 1 + run.width, stroke: hue(run), "stroke-dasharray": run.dash }, box);
}

// Draws a picture whenever its box gets another width, and on paper at the paper's.
const pictures = [];
let printing = false;

function follow(box, draw, paperWidth) {
  const picture = { width: 0 };
  picture.paper = () => { if (picture.width) draw(paperWidth); };
  picture.fit = () => {
    const width = Math.round(box.clientWidth);
    if (printing || !width || width === picture.width) return;
    picture.width = width;
    draw(width);
  };
  pictures.push(picture);
  // Not at once: drawing changes the box's height, which the observer would report in turn.
  new ResizeObserver(() => requestAnimationFrame(picture.fit)).observe(box);
}

// Says below a table that is wider than its box that there is more of it.
function cue(box) {
  const note = html("p", "More columns to the right: scroll sideways.", null, "note cue");
  note.hidden = true; // until measured, which waits for folded tables to be opened
  box.after(note);
  const check = () => { note.hidden = box.scrollWidth - box.clientWidth - box.scrollLeft < 4; };
  box.addEventListener("scroll", check);
  new ResizeObserver(check).observe(box);
  if (box.firstElementChild) new ResizeObserver(check).observe(box.firstElementChild);
}

// On paper nothing is folded.
let folded = [];
window.addEventListener("beforeprint", () => {
  printing = true;
  folded = [...document.querySelectorAll("details:not([open])")];
  for (const details of folded) details.open = true;
  for (const p of pictures) p.paper();
});
window.addEventListener("afterprint", () => {
  printing = false;
  for (const details of folded) details.open = false;
  for (const p of pictures) { p.width = 0; p.fit(); }
});
