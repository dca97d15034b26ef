// Scatter of two columns, coloured by class: hover names an example, a click opens it.

import { getJson } from "./api.js";
import { themeColours } from "./canvas.js";
import { makeChart } from "./chart.js";
import { addColumns, columnWords } from "./filters.js";
import { counted } from "./table.js";
import { dot, element, field, makePanel, showError, significant } from "./ui.js";

const RADIUS = 2.5;
const REACH = 10; // pixels from a point within which the mouse means it
const MARGINS = { left: 60, right: 12, top: 6, bottom: 36 };

/** Panel with the scatter; `onAxes({x} or {y})` when another column is chosen, `onOpen(id)` for a click. */
export function makeScatter(container, facts, colours, { onAxes, onOpen }) {
  const panel = makePanel("scatter", "Scatter");
  const numbers = facts.columns.filter((column) => column.kind === "number");
  const selects = { x: axisSelect("x"), y: axisSelect("y") };
  const legend = element("p", { class: "legend" });
  panel.tools.append(field("x", selects.x), field("y", selects.y));
  panel.node.append(legend);
  container.append(panel.node);
  let points = null;
  let named = { row: null, id: "" };
  const chart = makeChart(panel, "scatter", {
    label: "Two columns of the dataset against each other", view, draw: drawPoints, drawOver, read, margins: MARGINS,
  });
  panel.body.addEventListener("click", onClick);
  return { draw, destroy: chart.destroy };

  function axisSelect(axis) {
    const select = element("select", { id: `scatter-${axis}`, onchange: () => onAxes({ [axis]: select.value }) });
    addColumns(select, numbers);
    return select;
  }

  function draw({ facts: found, arrays }) {
    points = { ...found, ...arrays, axes: { x: axisOf(found.x, arrays.x), y: axisOf(found.y, arrays.y) } };
    selects.x.value = found.x.name;
    selects.y.value = found.y.name;
    panel.say(found.n_known ? null : "Both values are unknown in all of these rows.");
    drawLegend();
    chart.redraw();
  }

  function drawLegend() {
    const names = points.classes.map((label) => element("span", {}, dot(colours[label] ?? "#888888"), label));
    const [shown, known, all] = [points.x.length, points.n_known, points.n_matching];
    const part = shown < known ? `${counted(shown)} of ${counted(known)} points, evenly chosen` : `${counted(known)} points`;
    const unknown = known < all ? `; ${counted(all - known)} rows without both values` : "";
    legend.replaceChildren(...names, element("span", { class: "faint" }, part + unknown));
  }

  function view() {
    return points?.x.length ? points.axes : null;
  }

  /** Place of a point on the screen. */
  function placeOf(n) {
    const { x, y } = points.axes;
    return [chart.x(points.x[n] / x.scale), chart.y(points.y[n] / y.scale)];
  }

  function drawPoints(context) {
    context.fillStyle = themeColours().panel;
    context.fillRect(chart.box.left, chart.box.top, chart.box.right - chart.box.left, chart.box.bottom - chart.box.top);
    context.globalAlpha = points.x.length > 1500 ? 0.55 : 0.8;
    for (let n = 0; n < points.x.length; n += 1) {
      context.fillStyle = colours[points.classes[points.class[n]]] ?? "#888888";
      context.beginPath();
      context.arc(...placeOf(n), RADIUS, 0, 2 * Math.PI);
      context.fill();
    }
    context.globalAlpha = 1;
  }

  function drawOver(context) {
    const n = points.x.findIndex((_, place) => points.row[place] === named.row);
    if (n < 0) return;
    context.strokeStyle = getComputedStyle(panel.node).color;
    context.lineWidth = 2;
    context.beginPath();
    context.arc(...placeOf(n), RADIUS + 3, 0, 2 * Math.PI);
    context.stroke();
  }

  function nearest(x, y) {
    let [best, distance] = [-1, REACH];
    for (let n = 0; n < points.x.length; n += 1) {
      const [px, py] = placeOf(n);
      const away = Math.hypot(px - x, py - y);
      if (away < distance) [best, distance] = [n, away];
    }
    return best;
  }

  function read(x, y) {
    const n = nearest(chart.x(x), chart.y(y));
    if (n < 0) {
      named = { row: null, id: "" };
      return "";
    }
    const row = points.row[n];
    if (named.row !== row) askName(row);
    const label = points.classes[points.class[n]];
    return `${named.id || label}: ${["x", "y"].map((axis) => withUnit(points[axis][n], points.axes[axis])).join(", ")}`;
  }

  async function askName(row) {
    named = { row, id: "" };
    try {
      const { id } = await getJson("api/row-id", { row });
      if (named.row !== row) return;
      named.id = id;
      chart.redrawOverlay();
    } catch (error) {
      if (error.name !== "AbortError") showError(error);
    }
  }

  async function onClick(event) {
    if (!points?.x.length) return;
    const { left, top } = panel.body.getBoundingClientRect();
    const n = nearest(event.clientX - left, event.clientY - top);
    if (n < 0) return;
    try {
      onOpen((await getJson("api/row-id", { row: points.row[n] }, { key: null })).id);
    } catch (error) {
      showError(error);
    }
  }
}

/**
 * Axis of a column: its limits, and its unit. Very large and very small numbers are shown as multiples of a power of
 * ten (`scale`), so that their labels stay short.
 */
function axisOf(column, values) {
  const [low, high] = widened(values);
  const size = Math.max(Math.abs(low), Math.abs(high));
  const power = size >= 1e5 || size < 0.02 ? 3 * Math.floor(Math.log10(size) / 3) : 0;
  const scale = 10 ** power;
  const unit = power ? `10${[...String(power)].map((sign) => RAISED[sign]).join("")} ${column.unit}`.trim() : column.unit || "1";
  return { limits: [low / scale, high / scale], name: columnWords(column, false), unit, scale };
}

const RAISED = Object.fromEntries([..."-0123456789"].map((sign, n) => [sign, [..."⁻⁰¹²³⁴⁵⁶⁷⁸⁹"][n]]));

function withUnit(value, { scale, unit }) {
  return `${significant(value / scale)}${unit === "1" ? "" : ` ${unit}`}`;
}

/** Limits of an axis: all values and a margin; a single value stands in the middle. */
function widened(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  const margin = 0.04 * (high - low) || Math.abs(low) * 0.1 || 1;
  return [low - margin, high + margin];
}
