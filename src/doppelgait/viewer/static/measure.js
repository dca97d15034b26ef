// Measuring: two points in a picture, and the difference between them.

import { FONT } from "./axes.js";
import { withEdge } from "./chart.js";
import { element, fixed } from "./ui.js";

const COLOUR = "#9cff57";

/** One measurement for all charts. `button` switches it on; `changed()` is called when something must be drawn again. */
export function makeMeasure(changed) {
  const button = element("button", { id: "measure", type: "button", "aria-pressed": "false", onclick: () => toggle() }, "measure");
  button.title = "Click two points of a picture: differences in time, range, Doppler and velocity (m; Esc ends)";
  const measure = { on: false, chart: null, from: null, to: null, done: false, button, toggle, start, move, finish, draw };
  return measure;

  function toggle(on = !measure.on) {
    Object.assign(measure, { on, chart: null, from: null, to: null, done: false });
    button.setAttribute("aria-pressed", String(on));
    document.body.classList.toggle("measuring", on);
    changed();
  }

  /** First point, or the second of a measurement that has begun in this chart. */
  function start(chart, point) {
    if (measure.chart === chart && !measure.done) return finish(chart, point);
    Object.assign(measure, { chart, from: point, to: point, done: false });
    changed();
  }

  function move(chart, point) {
    if (measure.chart !== chart || measure.done) return;
    measure.to = point;
    changed();
  }

  function finish(chart, point) {
    if (measure.chart === chart) Object.assign(measure, { to: point, done: true });
    changed();
  }

  function draw(context, chart) {
    if (measure.chart !== chart) return;
    const [from, to] = [measure.from, measure.to].map(([x, y]) => [chart.x(x), chart.y(y)]);
    withEdge(context, COLOUR, 1.6, () => {
      context.beginPath();
      context.moveTo(...from);
      context.lineTo(...to);
      context.stroke();
      for (const point of [from, to]) {
        context.beginPath();
        context.arc(...point, 3, 0, 2 * Math.PI);
        context.stroke();
      }
    });
    label(context, chart.box, difference(chart.view, measure.from, measure.to), to);
  }
}

/** "1.20 s · 35.0 Hz · 0.72 m/s" between two points of a chart; of time and range also the speed between them. */
export function difference({ x, y, second }, from, to) {
  const [across, up] = [to[0] - from[0], to[1] - from[1]];
  const parts = [`Δ ${fixed(across, 3)} ${x.unit}`, `${fixed(up, y.unit === "Hz" ? 2 : 3)} ${y.unit}`];
  if (second) parts.push(`${fixed(up * second.scale, 3)} ${second.unit}`);
  if (x.unit === "s" && y.unit === "m" && across) parts.push(`${fixed(-up / across, 3)} m/s`); // approaching is positive
  return parts.join(" · ");
}

function label(context, { left, right, top, bottom }, words, [x, y]) {
  context.font = FONT;
  const width = context.measureText(words).width + 10;
  const at = { x: Math.min(Math.max(x + 8, left), right - width), y: y - 26 < top ? Math.min(y + 8, bottom - 18) : y - 26 };
  context.fillStyle = "rgba(0, 0, 0, 0.75)";
  context.fillRect(at.x, at.y, width, 18);
  context.fillStyle = COLOUR;
  context.textAlign = "left";
  context.textBaseline = "middle";
  context.fillText(words, at.x + 5, at.y + 9);
}
