// The bent arm at a time, drawn over the paths.
const MODE_ROOT = 1.8751040687119611;
const MODE_RATIO = (Math.cosh(MODE_ROOT) + Math.cos(MODE_ROOT)) / (Math.sinh(MODE_ROOT) + Math.sin(MODE_ROOT));

// First mode of a clamped-free beam at s of its length (0 to 1), 1 at the free end.
function modeShape(s) {
  const z = MODE_ROOT * s;
  return (Math.cosh(z) - Math.cos(z) - MODE_RATIO * (Math.sinh(z) - Math.sin(z))) / 2;
}

// Points of a link from p to q whose end lies `deflection` to the left of its tangent at p.
function linkPoints(px, py, qx, qy, deflection, parts) {
  const chord = Math.hypot(qx - px, qy - py);
  const along = Math.sqrt(Math.max(0, chord * chord - deflection * deflection));
  const angle = Math.atan2(qy - py, qx - px) - Math.atan2(deflection, along);
  const cos = Math.cos(angle), sin = Math.sin(angle), points = [];
  for (let i = 0; i <= parts; i++) {
    const s = i / parts, x = s * along, y = deflection * modeShape(s);
    points.push([px + x * cos - y * sin, py + x * sin + y * cos]);
  }
  return points;
}

function armPoints(run, row) {
  const c = run.c, first = linkPoints(0, 0, c.elbow_x[row], c.elbow_y[row], c.delta1[row], 24);
  return { first, second: linkPoints(c.elbow_x[row], c.elbow_y[row], c.tip_x[row], c.tip_y[row], c.delta2[row], 24) };
}

function drawArm(chart, group, run, time) {
  if (!run.c.t.length) return;
  const row = rowAt(run, time), { first, second } = armPoints(run, row);
  const all = first.concat(second.slice(1));
  if (!all.every((p) => isFinite(p[0]) && isFinite(p[1]))) return;
  const g = svg("g", { class: time > run.end + 0.01 ? "ended" : "" }, group), stroke = hue(run);
  const at = (p) => chart.px(p[0]).toFixed(1) + " " + chart.py(p[1]).toFixed(1);
  svg("path", { d: "M" + all.map(at).join("L"), class: "arm", stroke, "stroke-width": 2 + 2 * run.width }, g);
  const dot = (p, r) => svg("circle", { cx: chart.px(p[0]).toFixed(1), cy: chart.py(p[1]).toFixed(1), r, class: "joint", stroke }, g);
  dot(second[0], 5);
  dot(second[24], 4);
  if (run.sensor !== null) {
    const s = Math.min(1, Math.max(0, (run.sensor - run.lengths[0]) / run.lengths[1])), p = second[Math.round(s * 24)];
    const x = chart.px(p[0]), y = chart.py(p[1]);
    svg("path", { d: `M${x} ${y - 8}L${x + 8} ${y}L${x} ${y + 8}L${x - 8} ${y}Z`, class: "joint", stroke }, g);
  }
}

function drawBase(chart, group) {
  svg("circle", { cx: chart.px(0), cy: chart.py(0), r: 6, class: "base" }, group);
}
