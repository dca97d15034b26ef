// Decisions over time, of a stream or of a recording: the probability of a class by track, and where the alarm begins.

import { drawPath, drawText } from "./axes.js";
import { drawLine, makeChart, withEdge } from "./chart.js";
import { gateColour } from "./range_time.js";
import { dot, element, fixed, makePanel } from "./ui.js";

const [ALARM, BACKGROUND] = ["#ff5a4d", "#15181c"];
const LABEL_PX = 15; // from one alarm's words to the next below

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

/**
 * Panel of decisions: `facts()` as the server describes them, `time()` the axis, `subject(marks)` the name and the colour
 * of a track, and the words at its line; `further` goes to the chart.
 */
export function makeEvidence({ id = "evidence", facts, time, subject = nameTrack, ...further }) {
  const panel = makePanel(id, "Decisions", "evidence");
  const keys = element("div", { class: "parts keys" });
  panel.body.after(keys);
  let lines = []; // {name, colour, words, marks}
  const chart = makeChart(panel, id, {
    label: "Probability of a class against time, by track",
    view: () =>
      facts()?.stop_s == null || !facts().shown_class
        ? null
        : { x: time(), y: { limits: [-0.08, 1.08], name: "p", unit: facts().shown_class } },
    draw,
    read,
    ...further,
  });
  return { node: panel.node, redraw, tick: chart.redrawOverlay, destroy: chart.destroy, chart };

  function redraw() {
    if (!facts()) return; // the panel keeps its place until it is known what it shows
    const { stop_s: stop, reason, complete, shown_class: shown } = facts();
    panel.say(shown === null ? "The model has no alarm." : stop == null ? reason || "No window so far." : null);
    const state = complete === false ? `, up to ${fixed(stop, 0)} s` : reason ? `, ended: ${reason}` : "";
    panel.heading.textContent = shown ? `Decisions: probability of ${shown}${state}` : "Decisions";
    lines = [...byTrack(facts()).values()].map((marks) => ({ ...subject(marks), marks }));
    keys.replaceChildren(...listKeys());
    chart.redraw();
  }

  /** What is drawn: tracks of one body are one; the other marks stand before their names. */
  function listKeys() {
    const { alarm_threshold: threshold, marks } = facts();
    const named = new Map(lines.map((line) => [line.name, line.colour]));
    const sorted = [...named].sort(([a], [b]) => a.localeCompare(b, "en", { numeric: true }));
    const found = sorted.map(([name, colour]) => [dot(colour, "swatch"), name]);
    if (marks.some((mark) => mark.label === null)) found.push(["○ undecided"]);
    if (threshold != null) found.push([`╌ alarm from ${fixed(threshold, 2)}`]);
    if (marks.some((mark) => mark.alarm)) found.push(["│ alarm begins"]);
    return found.map((parts) => element("span", {}, ...parts));
  }

  function draw(context) {
    const { left, right, top, bottom } = chart.box;
    context.fillStyle = BACKGROUND;
    context.fillRect(left, top, right - left, bottom - top);
    const { alarm_threshold: threshold } = facts();
    if (threshold !== null) {
      context.setLineDash([6, 4]);
      withEdge(context, ALARM, 1.4, () => drawPath(context, [[left, chart.y(threshold)], [right, chart.y(threshold)]]));
      context.setLineDash([]);
    }
    for (const { marks, colour } of lines) {
      withEdge(context, colour, 1.8, () => drawLine(context, chart, marks.length, (n) => [marks[n].time_s, marks[n].evidence]));
      drawDots(context, chart, marks, "evidence", colour);
    }
    for (const { words, marks, colour } of lines) {
      const { time_s: time, evidence } = marks[marks.length >> 1];
      drawText(context, words, chart.x(time), chart.y(evidence) + (evidence > 0.5 ? 6 : -19), colour);
    }
    const alarms = lines.map((line) => ({ ...line, first: line.marks.find((mark) => mark.alarm) }));
    for (const [row, line] of alarms.filter(({ first }) => first).entries()) drawAlarm(context, line, row);
  }

  /** Here the alarm of a track begins, which stays. */
  function drawAlarm(context, { name, first: { time_s: time } }, row) {
    const { left, right, top, bottom } = chart.box;
    const [at, words] = [chart.x(time), `alarm, ${name}: ${fixed(time, 1)} s`];
    withEdge(context, ALARM, 2, () => drawPath(context, [[at, top], [at, bottom]]));
    const half = context.measureText(words).width / 2 + 6;
    if (at < left || at > right) return;
    drawText(context, words, at + (at + 2 * half < right ? half : -half), (top + bottom) / 2 + ((row % 4) - 1) * LABEL_PX, "#ff8a80");
  }

  /** The decision nearest to the mouse. */
  function read(time, value) {
    const away = (mark) => Math.hypot(chart.x(mark.time_s) - chart.x(time), chart.y(mark.evidence) - chart.y(value));
    const known = lines.flatMap(({ marks, name }) => marks.map((mark) => ({ ...mark, name }))).filter((mark) => Number.isFinite(mark.evidence));
    const mark = known.reduce((best, one) => (best && away(best) <= away(one) ? best : one), null);
    if (!mark || away(mark) > 40) return `${fixed(time, 2)} s · ${fixed(value, 2)}`;
    const decided = mark.label === null ? `undecided: ${mark.reason}` : mark.label;
    const alarm = mark.alarm ? " · alarm" : "";
    return `${fixed(mark.time_s, 2)} s · ${mark.name} · ${decided} · ${facts().shown_class} ${fixed(mark.evidence, 3)}${alarm}`;
  }
}

function nameTrack([{ track }]) {
  return { name: `track ${track}`, words: String(track), colour: gateColour(track) };
}
