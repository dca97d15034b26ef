// Tools that take two points of a picture, and one of them: the measurement of differences.

import { drawPath, FONT } from "./axes.js";
import { withEdge } from "./chart.js";
import { element, fixed } from "./ui.js";

const COLOUR = "#9cff57";

/**
 * A tool for all charts of a page, switched on by its button: two clicks, or a drag. `paint(context, chart, from, to)`
 * shows what is taken, `taken(from, to)` is called at its end, `changed()` when something must be drawn again.
 */
export function makeTool(page, words, title, { paint, taken = () => {}, fits = () => true, changed }) {
  const button = element("button", { id: words, type: "button", "aria-pressed": "false", title, onclick: () => toggle() }, words);
  const tool = { on: false, chart: null, from: null, to: null, done: false, button, toggle, start, move, finish, draw };
  page.tools.push(tool);
  return tool;

  function toggle(on = !tool.on) {
    for (const other of on ? page.tools : []) if (other.on) other.toggle(false);
    Object.assign(tool, { on, chart: null, from: null, to: null, done: false });
    button.setAttribute("aria-pressed", String(on));
    document.body.classList.toggle("measuring", page.tools.some((one) => one.on));
    changed();
  }

  /** First point, or the second of a pair that has begun in this chart. */
  function start(chart, point) {
    if (!fits(chart)) return;
    if (tool.chart === chart && !tool.done) return finish(chart, point);
    Object.assign(tool, { chart, from: point, to: point, done: false });
    changed();
  }

  function move(chart, point) {
    if (tool.chart !== chart || tool.done) return;
    tool.to = point;
    changed();
  }

  function finish(chart, point) {
    if (tool.chart !== chart || tool.done) return;
    Object.assign(tool, { to: point, done: true });
    taken(tool.from, point);
    changed();
  }

  function draw(context, chart) {
    if (tool.chart === chart) paint(context, chart, tool.from, tool.to);
  }
}

export function makeMeasure(page, changed) {
  const title = "Click two points of a picture: differences in time, range, Doppler and velocity (m; Esc ends)";
  return makeTool(page, "measure", title, { paint, changed });

  function paint(context, chart, ...points) {
    const [from, to] = points.map(([x, y]) => [chart.x(x), chart.y(y)]);
    withEdge(context, COLOUR, 1.6, () => {
      drawPath(context, [from, to]);
      for (const point of [from, to]) {
        context.beginPath();
        context.arc(...point, 3, 0, 2 * Math.PI);
        context.stroke();
      }
    });
    label(context, chart.box, difference(chart.view, ...points), to);
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
