// The live page: draws the frames that the server sends, or plays those of a recorded run.
"use strict";
const byId = (id) => document.getElementById(id);
const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const WINDOW = 3000; // points of a plot and of the trail
const PLOTS = [
  { title: "tip error, m", series: [["error", "tip_error", "--law"]] },
  { title: "deflections, m", series: [["link 1", "delta1", "--green"], ["link 2", "delta2", "--purple"]] },
  { title: "torque, N m", series: [["joint 1", "tau1", "--green"], ["joint 2", "tau2", "--purple"]] },
  { title: "strain gauges", series: [["link 1", "strain1", "--green"], ["link 2", "strain2", "--purple"]] },
  { title: "fuzzy gain lambda", series: [["lambda", "lambda", "--law"]] },
  { title: "age of the newest tip measurement, ms", series: [["age", "age_ms", "--amber"]] },
  { title: "ticks without a new tip measurement (lost, late or not due), %", series: [["held", "held_percent", "--amber"]] },
];
const view = { hello: null, frames: [], frame: null, recorded: null, at: 0, playing: true, seenAt: 0, plots: [], stale: true };

function text(tag, content, parent) {
  const node = document.createElement(tag);
  node.textContent = content;
  parent.appendChild(node);
  return node;
}

// --- the arm ---------------------------------------------------------------------------------
function drawArm() {
  const canvas = byId("arm"), ratio = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  const g = canvas.getContext("2d"), frame = view.frame;
  g.clearRect(0, 0, width, height);
  if (!frame || !view.hello) return;
  const reach = 1.08 * (view.hello.length[0] + view.hello.length[1]);
  const scale = Math.min(width, height) / (2 * reach);
  const at = (p) => [width / 2 + p[0] * scale, height / 2 - p[1] * scale];
  const line = (points, name, thick, dash) => {
    g.beginPath();
    let pen = false;
    for (const p of points) {
      if (!p) { pen = false; continue; }
      const [x, y] = at(p);
      if (pen) g.lineTo(x, y); else g.moveTo(x, y);
      pen = true;
    }
    g.strokeStyle = color(name); g.lineWidth = thick * ratio; g.setLineDash((dash || []).map((d) => d * ratio)); g.stroke();
    g.setLineDash([]);
  };
  const dot = (p, name, size, diamond) => {
    if (!p) return;
    const [x, y] = at(p), r = size * ratio;
    g.fillStyle = color(name);
    g.beginPath();
    if (diamond) { g.moveTo(x, y - r); g.lineTo(x + r, y); g.lineTo(x, y + r); g.lineTo(x - r, y); g.closePath(); } else g.arc(x, y, r, 0, 7);
    g.fill();
  };
  line(view.frames.map((f) => f.reference), "--purple", 1.5, [6, 4]);
  line(view.frames.map((f) => f.line[f.line.length - 1]), "--law", 1.5);
  line(frame.line, "--law", 5);
  dot(frame.line[0], "--fg", 6); dot(frame.line[frame.elbow], "--fg", 5); dot(frame.line[frame.line.length - 1], "--law", 5);
  dot(frame.reference, "--purple", 5); dot(frame.sensed, "--amber", 7, true);
}

// --- the plots -------------------------------------------------------------------------------
// uPlot's own text has three decimals, too few for the deflections of a small arm.
function tickText(value, step) {
  const minus = (text) => text.replaceAll("-", "−");
  if (Math.abs(value) < step / 2) return "0";
  if (step < 1e-3) return minus(Number(value.toPrecision(3)).toExponential());
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), scaled = step * 10 ** decimals;
  return minus(value.toFixed(decimals + (Math.abs(scaled - Math.round(scaled)) > 1e-6 ? 1 : 0)));
}

function makePlots() {
  const box = byId("plots");
  box.textContent = "";
  const there = { lambda: view.frames.some((f) => f.lambda !== null), strain1: !!(view.hello && view.hello.strain) };
  view.plots = PLOTS.filter((p) => there[p.series[0][1]] ?? true).map((plot) => {
    const div = document.createElement("div");
    div.className = "plot";
    box.appendChild(div);
    const axis = { stroke: color("--soft"), grid: { stroke: color("--line"), width: 1 }, ticks: { stroke: color("--line"), width: 1 } };
    const options = {
      title: plot.title + (plot.series[0][1] === "strain1" ? ", " + view.hello.strain : ""), width: div.clientWidth || 300, height: 120, cursor: { drag: { x: true, y: false }, sync: { key: "time" } },
      scales: { x: { time: false } }, legend: { live: true },
      axes: [{ ...axis, size: 28 }, { ...axis, size: 70, space: 22, values: (u, ticks, index, space, step) => ticks.map((value) => tickText(value, step)) }],
      series: [{ label: "t, s" }, ...plot.series.map(([label, , name]) => ({ label, stroke: color(name), width: 1.5, spanGaps: false, value: (u, value) => (value === null ? "--" : String(Number(value.toPrecision(4)))) }))],
    };
    return { plot, chart: new uPlot(options, [[], ...plot.series.map(() => [])], div), div };
  });
}

function drawPlots() {
  const times = view.frames.map((f) => f.t);
  for (const { plot, chart } of view.plots) {
    chart.setData([times, ...plot.series.map(([, key]) => view.frames.map((f) => (f[key] === undefined ? null : f[key])))]);
  }
}

// --- frames ----------------------------------------------------------------------------------
// State and measurement are taken one after the other while the run goes on, so that the age of one
// frame may be off by a tick or two: the median of the last nine frames is shown.
function medianAge(frame) {
  if (frame.age === null) return null;
  const ages = view.frames.slice(-8).map((f) => f.age).filter((age) => age !== null);
  return 1000 * ages.concat(frame.age).sort((a, b) => a - b)[ages.length >> 1];
}

const percent = (share) => (share == null ? null : 100 * share);

function take(frame) {
  const last = view.frames[view.frames.length - 1];
  if (last && frame.t < last.t) view.frames.length = 0; // the run began anew
  frame.age_ms = medianAge(frame);
  frame.held_percent = percent(frame.held);
  if (!last || frame.t !== last.t) view.frames.push(frame);
  if (view.frames.length > WINDOW) view.frames.splice(0, view.frames.length - WINDOW);
  view.frame = frame;
  view.stale = true;
  if (frame.state) showState(frame.state);
}

function showState(name) {
  byId("state").textContent = name;
  byId("state").className = name === "no server" || name === "failed" ? "bad" : "";
  if (!view.recorded) byId("play").textContent = name === "paused" ? "Continue" : "Pause";
}

function paint(now) {
  if (view.recorded) playRecorded(now);
  if (view.stale) {
    view.stale = false;
    if (!view.plots.length && view.frames.length) makePlots();
    drawArm();
    drawPlots();
    if (view.frame) byId("time").textContent = view.frame.t.toFixed(3) + " s";
  }
  requestAnimationFrame(paint);
}

// --- a recorded run --------------------------------------------------------------------------
function playRecorded(now) {
  const all = view.recorded, span = all[all.length - 1].t - all[0].t;
  if (view.playing && view.seenAt) {
    view.at += ((now - view.seenAt) / 1000) * Number(byId("speed").value);
    if (view.at > span) { view.at = span; view.playing = false; }
  }
  view.seenAt = now;
  let index = all.findIndex((f) => f.t - all[0].t > view.at + 1e-9) - 1;
  if (index < 0) index = view.at > 0 ? all.length - 1 : 0;
  byId("play").textContent = view.playing ? "Pause" : "Play";
  if (view.frame === all[index]) return;
  view.frames = all.slice(0, index + 1);
  view.frame = all[index];
  byId("scrub").value = String(index);
  view.stale = true;
}

async function startRecorded() {
  const recorded = await (await fetch("recording.json")).json();
  for (const f of recorded.frames) { f.age_ms = f.age === null ? null : 1000 * f.age; f.held_percent = percent(f.held); }
  view.recorded = recorded.frames;
  document.body.classList.add("recorded");
  byId("scrub").hidden = false;
  byId("scrub").max = String(recorded.frames.length - 1);
  showState("recorded");
}

// --- commands --------------------------------------------------------------------------------
let commands = 0;

async function command(body) {
  const number = ++commands;
  let problem = "";
  try {
    const answer = await fetch("command", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
    problem = (await answer.json()).problem;
  } catch (error) { problem = "the server does not answer"; }
  if (number === commands) { // a late answer to an earlier command must not hide the newest one's
    byId("notice").textContent = problem;
    byId("notice").hidden = !problem;
  }
  return !problem;
}

function showParameters() {
  const law = view.hello.law;
  for (const p of view.hello.parameters) {
    const id = `${p.node}.${p.key}`, known = byId(id);
    if (known) {
      if (document.activeElement !== known && document.activeElement !== byId(id + ".number")) { known.value = String(p.value); byId(id + ".number").value = String(p.value); }
      continue;
    }
    const others = p.node === "controller" && p.key.includes(".") && !p.key.startsWith(law + ".");
    const box = document.createElement("div");
    box.className = "parameter";
    byId(others ? "more-parameters" : "main-parameters").appendChild(box);
    const label = text("label", `${id}${p.unit ? ", " + p.unit : ""}`, box);
    label.htmlFor = id; label.title = p.doc;
    const slider = document.createElement("input"), number = document.createElement("input");
    Object.assign(slider, { type: "range", id, min: String(p.range[0]), max: String(p.range[1]), step: String((p.range[1] - p.range[0]) / 200 || 1) });
    Object.assign(number, { type: "number", id: id + ".number", step: "any" });
    number.setAttribute("aria-label", id);
    slider.value = number.value = String(p.value);
    box.append(slider, number);
    const set = async (value) => {
      if (Number.isFinite(value)) await command({ action: "set", node: p.node, key: p.key, value: Number(value.toPrecision(6)) });
    };
    slider.addEventListener("input", () => { number.value = String(Number(Number(slider.value).toPrecision(6))); });
    slider.addEventListener("change", () => set(Number(slider.value)));
    number.addEventListener("change", () => { slider.value = number.value; set(Number(number.value)); });
  }
}

function greet(hello) {
  const before = view.hello;
  view.hello = hello;
  document.documentElement.dataset.law = hello.law;
  byId("run").textContent = hello.law ? `law ${hello.law}, feedback ${hello.feedback}` : "no run yet";
  if (hello.recorded && !view.recorded) startRecorded();
  if (before && before.strain !== hello.strain) view.plots = [];
  if (before && before.law !== hello.law) { byId("main-parameters").textContent = ""; byId("more-parameters").textContent = ""; view.frames.length = 0; view.plots = []; }
  showParameters();
}

byId("play").addEventListener("click", () => {
  if (!view.recorded) { command({ action: view.frame && view.frame.state === "paused" ? "resume" : "pause" }); return; }
  if (!view.playing && view.at >= view.recorded[view.recorded.length - 1].t - view.recorded[0].t) view.at = 0;
  view.playing = !view.playing;
});
byId("step").addEventListener("click", () => command({ action: "step" }));
byId("reset").addEventListener("click", () => command({ action: "reset" }));
byId("speed").addEventListener("change", () => { if (!view.recorded) command({ action: "set", node: "plant", key: "real_time_factor", value: Number(byId("speed").value) }); });
byId("scrub").addEventListener("input", () => { view.playing = false; view.at = view.recorded[Number(byId("scrub").value)].t - view.recorded[0].t; });
// Not on "resize" alone: the list of parameters brings a scroll bar, which narrows the page.
new ResizeObserver(() => { for (const { chart, div } of view.plots) chart.setSize({ width: div.clientWidth, height: 120 }); view.stale = true; }).observe(byId("plots"));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { view.plots = []; view.stale = true; });

const stream = new EventSource("events");
stream.addEventListener("hello", (event) => greet(JSON.parse(event.data)));
stream.addEventListener("frame", (event) => { if (!view.recorded) take(JSON.parse(event.data)); });
stream.addEventListener("state", (event) => { if (!view.recorded) showState(JSON.parse(event.data)); });
stream.onerror = () => { if (!view.recorded) showState("no server"); };
stream.onopen = () => { if (!view.recorded) showState("waiting for a run"); };
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { view.plots = []; view.stale = true; });
requestAnimationFrame(paint);
