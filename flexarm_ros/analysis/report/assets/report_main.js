// Puts the page together: runs, pictures, time, controls.
const page = JSON.parse(byId("data").textContent);
const runs = loadRuns(page);
const shown = () => runs.filter((run) => run.shown);
const layered = () => shown().sort((a, b) => b.width - a.width); // a thin curve over a wide one
const endTime = Math.max(1e-9, ...runs.map((run) => run.end));
const state = { time: 0, playing: false, before: 0 };

const heading = (name) => Object.hasOwn(page.labels, name) ? page.labels[name][0].replace(/^./, (c) => c.toUpperCase()) : name;
const SERIES = [
  ...["error", "tip_error", "delta1", "delta2", "tau1", "tau2", "lambda"].map((name) => [name, "main"]),
  ...["theta1", "theta2", "meas_x", "meas_y"].map((name) => [name, "angles"]),
  ...[...new Set(runs.flatMap((run) => run.optional))].map((name) => [name, "parts"]),
];
const VALUES = ["error", "tip_error", "delta1", "delta2", "tau1", "tau2", "lambda", "rigid_x", "rigid_y"];
const known = (name) => runs.some((run) => name in run.c && run.c[name].some(isFinite));
const switches = runs.reduce((most, run) => (run.switches.length > most.length ? run.switches : most), []);
let timeView = null;

const paths = new Chart(byId("paths"), {
  label: "Paths of the end effector, with the arm at the time shown", xLabel: "x, m", yLabel: "y, m", equal: true, paperWidth: 530,
  height: (w) => Math.min(w, 680) + 10,
  curves: () => {
    const list = [], seen = new Set();
    for (const run of shown()) {
      const key = run.columns.ref_x + "," + run.columns.ref_y;
      if (!seen.has(key)) list.push({ run, x: run.c.ref_x, y: run.c.ref_y, className: "reference", dash: "6 4", width: 1 });
      seen.add(key);
    }
    for (const run of layered()) list.push({ run, x: run.c.rigid_x, y: run.c.rigid_y });
    if (byId("show-tip").checked) for (const run of shown()) list.push({ run, x: run.c.tip_x, y: run.c.tip_y, className: "thin", dash: "2 3", width: 1 });
    return list;
  },
  alsoShown: () => {
    if (!byId("show-arm").checked) return [];
    return [{ x: [0], y: [0] }, ...shown().flatMap((run) => [{ x: run.c.tip_x, y: run.c.tip_y }, { x: run.c.elbow_x, y: run.c.elbow_y }])];
  },
  overlay: (chart, group) => {
    drawBase(chart, group);
    if (byId("show-arm").checked) for (const run of shown()) drawArm(chart, group, run, state.time);
    for (const run of shown()) {
      if (!run.c.t.length) continue;
      const row = rowAt(run, state.time), x = run.c.rigid_x[row], y = run.c.rigid_y[row];
      if (isFinite(x) && isFinite(y)) svg("circle", { cx: chart.px(x), cy: chart.py(y), r: 4, class: "joint", stroke: hue(run) }, group);
    }
  },
  onSeek: (x, y, chart) => { const hit = nearest(x, y, chart); if (hit) setTime(hit.run.c.t[hit.row]); },
  values: (x, y, chart) => {
    const hit = nearest(x, y, chart);
    if (!hit) return null;
    const c = hit.run.c, i = hit.row;
    return [{ run: hit.run, text: hit.run.label }, { text: `t = ${c.t[i].toFixed(3)} s, x = ${show(c.rigid_x[i])} m, y = ${show(c.rigid_y[i])} m` }, { text: `error ${show(c.error[i])} m` }];
  },
});

// The recorded point within 24 pixels of a place in the picture.
function nearest(x, y, chart) {
  let best = null, least = 24;
  const a = chart.px(x), b = chart.py(y);
  for (const run of shown()) {
    for (let i = 0; i < run.c.t.length; i++) {
      const d = Math.hypot(chart.px(run.c.rigid_x[i]) - a, chart.py(run.c.rigid_y[i]) - b);
      if (d < least) { least = d; best = { run, row: i }; }
    }
  }
  return best;
}

const series = SERIES.filter(([name]) => known(name)).map(([name, group]) => {
  const box = html("div", null, byId("series"), "chart");
  const chart = new Chart(box, {
    label: heading(name) + " over time", xLabel: "time, s", yLabel: heading(name), paperWidth: 700, height: (w) => (w < 480 ? 170 : 190),
    curves: () => layered().filter((run) => name in run.c).map((run) => ({ run, x: run.c.t, y: run.c[name] })),
    marks: () => switches,
    overlay: (c, g) => svg("line", { class: "cursor", x1: c.px(state.time), x2: c.px(state.time), y1: c.plot.y, y2: c.plot.y + c.plot.h }, g),
    onSeek: (x) => setTime(x),
    onView: (view) => setTimeView(view, chart),
    values: (x) => {
      const time = Math.min(endTime, Math.max(0, x));
      const lines = [{ text: `t = ${time.toFixed(3)} s` }];
      for (const run of shown()) if (name in run.c && run.c.t.length && time <= run.end + 1e-9) lines.push({ run, text: `${show(run.c[name][rowAt(run, time)])}  ${run.label}` });
      return lines;
    },
  });
  return { chart, group, box };
});

function setTimeView(view, source) {
  timeView = view;
  for (const { chart } of series) if (chart !== source) { chart.view = view; chart.draw(); }
}

function setTime(time) {
  state.time = Math.min(endTime, Math.max(0, time));
  byId("scrub").value = state.time;
  byId("clock").textContent = state.time.toFixed(3) + " s";
  byId("now").textContent = `t = ${state.time.toFixed(3)} s`;
  paths.overlay();
  for (const { chart, box } of series) if (!box.hidden) chart.overlay();
  fillValues();
}

function fillValues() {
  const cells = byId("values").querySelectorAll("td");
  let k = 0;
  for (const name of VALUES) {
    for (const run of runs) {
      const there = run.c.t.length && state.time <= run.end + 0.01;
      cells[k++].textContent = there ? show(run.c[name][rowAt(run, state.time)]) : "–";
    }
  }
}

function buildValues() {
  const table = byId("values"), head = html("tr", null, html("thead", null, table)), body = html("tbody", null, table);
  html("th", "Quantity", head).scope = "col";
  for (const run of runs) {
    const name = html("th", null, head);
    name.scope = "col";
    swatch(run, name);
    const shown = html("span", null, name, "name");
    // It breaks after underscores, not inside words.
    for (const part of run.name.split(/(?<=_)/)) shown.append(part, document.createElement("wbr"));
  }
  for (const name of VALUES) {
    const row = html("tr", null, body);
    html("th", page.labels[name][1], row).scope = "row";
    for (let i = 0; i < runs.length; i++) html("td", "–", row);
  }
}

function buildRuns() {
  for (const run of runs) {
    const label = html("label", null, byId("runs")), box = html("input", null, label);
    box.type = "checkbox";
    box.checked = true;
    label.appendChild(document.createTextNode(" "));
    swatch(run, label);
    label.appendChild(document.createTextNode(run.label + (run.label.includes(run.name) ? "" : ` (${run.name})`)));
    box.addEventListener("change", () => { run.shown = box.checked; redraw(); });
  }
}

function redraw() {
  paths.draw();
  for (const { chart } of series) chart.draw();
}

function play(on) {
  state.playing = on;
  state.before = performance.now();
  byId("play").textContent = on ? "⏸ Pause" : "▶ Play";
  byId("play").setAttribute("aria-pressed", String(on));
  if (on && state.time >= endTime - 1e-9) setTime(0);
  if (on) requestAnimationFrame(frame);
}

function frame(now) {
  if (!state.playing) return;
  setTime(state.time + Math.max(0, now - state.before) / 1000 * Number(byId("speed").value));
  state.before = now;
  if (state.time >= endTime - 1e-9) play(false); else requestAnimationFrame(frame);
}

// Shows one direction switch in all pictures.
function showSwitch(time) {
  let x0 = Infinity, x1 = -Infinity, y0 = Infinity, y1 = -Infinity;
  for (const run of shown()) {
    const c = run.c;
    for (let i = 0; i < c.t.length; i++) {
      if (c.t[i] < time - 0.2 || c.t[i] > time + 0.8) continue;
      for (const [x, y] of [[c.rigid_x[i], c.rigid_y[i]], [c.ref_x[i], c.ref_y[i]]]) {
        if (x < x0) x0 = x;
        if (x > x1) x1 = x;
        if (y < y0) y0 = y;
        if (y > y1) y1 = y;
      }
    }
  }
  if (!(x1 > x0 || y1 > y0)) return;
  const pad = 0.06 * Math.max(x1 - x0, y1 - y0);
  paths.setView({ x0: x0 - pad, x1: x1 + pad, y0: y0 - pad, y1: y1 + pad });
  setTimeView({ x0: Math.max(0, time - 0.5), x1: Math.min(endTime, time + 2) }, null);
  setTime(time);
}

function centre() {
  const run = shown()[0] || runs[0], row = rowAt(run, state.time);
  return [run.c.rigid_x[row] || 0, run.c.rigid_y[row] || 0];
}

function shiftTime(part) {
  if (!timeView) return;
  const span = timeView.x1 - timeView.x0, x0 = Math.min(endTime - span, Math.max(0, timeView.x0 + part * span));
  setTimeView({ x0, x1: x0 + span }, null);
}

function chooseSeries() {
  const which = byId("which").value;
  for (const { group, box } of series) box.hidden = which !== "all" && group !== which;
  for (const { chart, box } of series) if (!box.hidden) chart.draw();
}

function keys(event) {
  const chart = [paths, ...series.map((s) => s.chart)].find((c) => c.box === document.activeElement);
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === " " && (chart || document.activeElement === document.body)) play(!state.playing);
  else if (!chart) return;
  else if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
    const v = series.length && series[0].chart.v, span = timeView ? timeView.x1 - timeView.x0 : v ? v.x1 - v.x0 : endTime;
    setTime(state.time + (event.key === "ArrowLeft" ? -1 : 1) * (event.shiftKey ? 0.05 : 0.005) * span);
  } else if (event.key === "+" || event.key === "=" || event.key === "-") {
    const factor = event.key === "-" ? 1.6 : 0.625, [x, y] = centre();
    if (chart === paths) chart.zoom(factor, x, y); else chart.zoom(factor, state.time, 0);
  } else if (event.key === "0" || event.key === "Escape") chart.setView(null);
  else return;
  event.preventDefault();
}

function buildFls() {
  const box = byId("fls");
  if (!box || !page.fls) return;
  drawSets(box, page.fls.inputs, page.fls.kn, "deflection δ₁ or δ₂, m", "Membership functions of the deflections");
  drawSets(box, page.fls.outputs, 1, "gain λ", "Membership functions of lambda");
  const surface = new Surface(byId("surface"), page.fls, runs);
  byId("surface-range").addEventListener("change", (event) => { surface.grid = Number(event.target.value); surface.draw(); });
  const turn = (id, a, b) => byId(id).addEventListener("click", () => surface.rotate(a, b));
  turn("surface-left", -0.2, 0);
  turn("surface-right", 0.2, 0);
  turn("surface-up", 0, 0.15);
  turn("surface-down", 0, -0.15);
}

function buildTheme() {
  const names = { "": "automatic", light: "light", dark: "dark" }, order = ["", "light", "dark"];
  let at = 0;
  byId("theme").addEventListener("click", () => {
    at = (at + 1) % order.length;
    if (order[at]) document.documentElement.dataset.theme = order[at];
    else delete document.documentElement.dataset.theme;
    byId("theme").textContent = "Theme: " + names[order[at]];
  });
}

function connect() {
  const click = (id, action) => byId(id).addEventListener("click", action);
  const first = () => series[0] && series[0].chart;
  click("play", () => play(!state.playing));
  click("start", () => setTime(0));
  click("path-in", () => paths.zoom(0.625, ...centre()));
  click("path-out", () => paths.zoom(1.6, ...centre()));
  click("path-reset", () => paths.setView(null));
  click("time-in", () => first() && first().zoom(0.625, state.time, 0));
  click("time-out", () => first() && first().zoom(1.6, state.time, 0));
  click("time-left", () => shiftTime(-0.25));
  click("time-right", () => shiftTime(0.25));
  click("time-reset", () => setTimeView(null, null));
  byId("scrub").max = endTime;
  byId("scrub").step = Math.max(1e-4, Number((endTime / 4000).toPrecision(1)));
  byId("scrub").addEventListener("input", (event) => { play(false); setTime(Number(event.target.value)); });
  for (const id of ["show-tip", "show-arm"]) byId(id).addEventListener("change", () => paths.draw());
  byId("which").addEventListener("change", chooseSeries);
  switches.slice(0, 12).forEach((time, i) => {
    const button = html("button", `Switch ${i + 1}`, byId("corners"));
    button.type = "button";
    button.addEventListener("click", () => showSwitch(time));
  });
  document.addEventListener("keydown", keys);
}

document.querySelectorAll(".scroll").forEach(cue);
byId("which-parts").hidden = !series.some(({ group }) => group === "parts");
document.querySelector(".motion").classList.toggle("many", runs.length > 3);
buildRuns();
buildValues();
buildFls();
buildTheme();
connect();
chooseSeries();
setTime(0);
document.documentElement.dataset.ready = "yes";
