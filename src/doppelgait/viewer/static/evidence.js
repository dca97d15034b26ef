// Decisions over time, of a stream or of a recording: the probability of a class by track, and where the alarm begins.

import { drawPath, FONT } from "./axes.js";
import { drawLine, makeChart, withEdge } from "./chart.js";
import { gateColour } from "./range_time.js";
import { fixed, makePanel } from "./ui.js";

const [ALARM, BACKGROUND] = ["#ff5a4d", "#15181c"];

/** The decisions by track, in the order of time. */
export function byTrack({ marks }) {
  return Map.groupBy(marks, (mark) => mark.track);
}

/** A dot for each decision; hollow where no class is decided. */
export function drawDots(context, chart, marks, field, colour) {
  context.lineWidth = 1.2;
  for (const mark of marks) {
    if (!Number.isFinite(mark[field])) continue;
    context.beginPath();
    context.arc(chart.x(mark.time_s), chart.y(mark[field]), 3, 0, 2 * Math.PI);
    context.fillStyle = mark.label === null ? BACKGROUND : colour;
    context.strokeStyle = colour;
    context.fill();
    context.stroke();
  }
}

/** Panel of decisions: `facts()` as the server describes them, `time()` the axis; `further` goes to the chart. */
export function makeEvidence({ id = "evidence", facts, time, margins, ...further }) {
  const panel = makePanel(id, "Decisions", "evidence");
  const chart = makeChart(panel, id, {
    label: "Probability of a class against time, by track",
    view: () =>
      facts()?.stop_s == null || !facts().shown_class
        ? null
        : { x: time(), y: { limits: [-0.08, 1.08], name: "p", unit: facts().shown_class }, margins },
    draw,
    read,
    ...further,
  });
  return { node: panel.node, redraw, tick: chart.redrawOverlay, destroy: chart.destroy, chart };

  function redraw() {
    const { stop_s: stop, reason, complete, shown_class: shown } = facts() ?? {};
    panel.say(shown === null ? "The model has no alarm." : stop == null ? reason || "No window so far." : null);
    const state = complete === false ? `, up to ${fixed(stop, 0)} s` : reason ? `, ended: ${reason}` : "";
    panel.heading.textContent = shown ? `Decisions: probability of ${shown}${state}` : "Decisions";
    chart.redraw();
  }

  function draw(context) {
    const { left, right, top, bottom } = chart.box;
    context.fillStyle = BACKGROUND;
    context.fillRect(left, top, right - left, bottom - top);
    context.font = FONT;
    const { alarm_threshold: threshold } = facts();
    if (threshold !== null) {
      context.setLineDash([6, 4]);
      withEdge(context, ALARM, 1.4, () => drawPath(context, [[left, chart.y(threshold)], [right, chart.y(threshold)]]));
      context.setLineDash([]);
      say(context, `alarm from ${fixed(threshold, 2)}`, right - 90, chart.y(threshold) + 13);
    }
    for (const [track, marks] of byTrack(facts())) {
      withEdge(context, gateColour(track), 1.8, () => drawLine(context, chart, marks.length, (n) => [marks[n].time_s, marks[n].evidence]));
      drawDots(context, chart, marks, "evidence", gateColour(track));
      const first = marks.find((mark) => mark.alarm);
      if (first) drawAlarm(context, first);
    }
  }

  /** Here the alarm of a track begins, which stays. */
  function drawAlarm(context, { time_s: time, track }) {
    const at = chart.x(time);
    withEdge(context, ALARM, 2, () => drawPath(context, [[at, chart.box.top], [at, chart.box.bottom]]));
    say(context, `alarm, track ${track}: ${fixed(time, 1)} s`, at + 5, chart.box.bottom - 20);
  }

  function say(context, words, x, y) {
    context.fillStyle = "#ff8a80";
    context.fillText(words, x, y);
  }

  /** The decision nearest to the mouse. */
  function read(time, value) {
    const away = (mark) => Math.hypot(chart.x(mark.time_s) - chart.x(time), chart.y(mark.evidence) - chart.y(value));
    const known = facts().marks.filter((mark) => Number.isFinite(mark.evidence));
    const mark = known.reduce((best, one) => (best && away(best) <= away(one) ? best : one), null);
    if (!mark || away(mark) > 40) return `${fixed(time, 2)} s · ${fixed(value, 2)}`;
    const decided = mark.label === null ? `undecided: ${mark.reason}` : mark.label;
    const alarm = mark.alarm ? " · alarm" : "";
    return `${fixed(mark.time_s, 2)} s · track ${mark.track} · ${decided} · ${facts().shown_class} ${fixed(mark.evidence, 3)}${alarm}`;
  }
}
