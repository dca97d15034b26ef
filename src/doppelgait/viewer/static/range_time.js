// Range against time, with the gates of the targets.

import { drawCursor, drawLine, makeChart, MARGINS, withEdge } from "./chart.js";
import { makeLevels } from "./levels.js";
import { edges } from "./picture.js";
import { fixed, makePanel } from "./ui.js";

/** Colours of the gates by number of the target; none of them occurs in the maps. */
export const GATE_COLOURS = ["#56b4e9", "#e69f00", "#ffffff", "#cc79a7", "#f0e442", "#009e73"];

/** Margins while the signature below has the same time axis, with its numbers. */
const ABOVE = { ...MARGINS, bottom: 10 };

export function gateColour(number) {
  return GATE_COLOURS[number % GATE_COLOURS.length];
}

const BEYOND_S = 0.25; // a gate has a value a processing interval, and so ends before the recording does

/** Limits of a target's gate in m at a time, from its nearest column; null without a gate or beyond its ends. */
export function gateAt(target, arrays, time) {
  if (!target?.gate_limits) return null;
  const { time: times, low, high } = target.gate_limits;
  const [at, count] = [arrays[times], arrays[times].length];
  if (!count) return null;
  if (time < at[0] - BEYOND_S || time > at[count - 1] + BEYOND_S) return null;
  const share = count > 1 ? (time - at[0]) / (at[count - 1] - at[0]) : 0;
  let n = Math.min(Math.max(Math.round(share * (count - 1)), 0), count - 1);
  while (n > 0 && Math.abs(at[n - 1] - time) < Math.abs(at[n] - time)) n -= 1;
  while (n < count - 1 && Math.abs(at[n + 1] - time) < Math.abs(at[n] - time)) n += 1;
  return [arrays[low][n], arrays[high][n]];
}

export function makeRangeTime(page, { id = "range-time", before = page.before } = {}) {
  const { session, clock, zoom } = page;
  const panel = makePanel(id, `${before}Range against time`, "range-time");
  const levels = makeLevels(panel, session, () => chart.redraw());
  let targets = null; // {targets, arrays, selected, overview}
  const chart = makeChart(panel, id, {
    label: "Range against time; click to move the time cursor",
    drag: (time) => clock.seek(time),
    zoom: { x: zoom.time },
    page,
    read,
    view: () =>
      levels.image && {
        margins: isAlone() ? MARGINS : ABOVE,
        x: { limits: zoom.time.limits([clock.start, clock.stop]), name: "time", unit: "s", labels: isAlone() },
        y: { limits: edges(levels.image.y), name: "range", unit: "m" },
      },
    draw,
    drawOver: (context) => drawCursor(context, chart, clock.time),
  });
  return { node: panel.node, show, refine: levels.refine, showTargets, redraw: levels.repaint, tick: chart.redrawOverlay, destroy: chart.destroy };

  function show({ facts, arrays }) {
    const image = facts.range_time;
    panel.say(image ? null : facts.reason || "No range-time map: this radar has one range bin.");
    levels.show(image, image && arrays[image.array]);
  }

  function showTargets(next) {
    targets = next;
    chart.redraw();
  }

  /** Whether no signature stands below, once that is known. */
  function isAlone() {
    return targets !== null && !(targets.targets[targets.selected] ?? targets.overview)?.signature;
  }

  function draw(context) {
    levels.draw(context, chart);
    for (const [number, target] of (targets?.targets ?? []).entries()) drawGate(context, target, number);
  }

  function drawGate(context, target, number) {
    if (!target.gate_limits) return;
    const { arrays, selected } = targets;
    const times = arrays[target.gate_limits.time];
    context.globalAlpha = number === selected ? 1 : 0.6;
    for (const side of ["low", "high"]) {
      const values = arrays[target.gate_limits[side]];
      withEdge(context, gateColour(number), number === selected ? 1.6 : 1, () =>
        drawLine(context, chart, times.length, (n) => [times[n], values[n]]),
      );
    }
    context.globalAlpha = 1;
  }

  function read(time, range) {
    const { x, y, level } = levels.at(time, range) ?? { x: time, y: range, level: "" };
    return `${fixed(x, 3)} s · ${fixed(y, 3)} m${level && ` · ${level}`}`;
  }
}

