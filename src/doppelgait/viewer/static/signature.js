// Micro-Doppler signature, of the whole track with its segments, the main lines, and the true Doppler of the body parts.

import { drawPath, drawText } from "./axes.js";
import { drawCursor, drawLine, makeChart, withEdge } from "./chart.js";
import { makeLevels } from "./levels.js";
import { edges, valueAt } from "./picture.js";
import * as state from "./state.js";
import { bodyOf } from "./truth.js";
import { dot, element, fixed, makePanel, shownSegment, span } from "./ui.js";

const MAIN_LINE = "#56b4e9";
const SEGMENT_COLOUR = "#ffe14d";
const DASHES = [[], [5, 3], [2, 3], [7, 3, 2, 3]];
const OTHER_BODY = 0.3; // opacity of the true Doppler of bodies that are not the chosen target
const EXTRAS = [["main-line", "main line", MAIN_LINE], ["segments", "segments", SEGMENT_COLOUR]];

export function makeSignature(page, { id = "signature", before = page.before } = {}) {
  const { session, clock, band, zoom } = page;
  const panel = makePanel(id, `${before}Micro-Doppler signature`, "signature");
  const parts = element("fieldset", { id: "parts", class: "parts" }, element("legend", {}, "Lines over the signature"));
  const levels = makeLevels(panel, session, () => chart.redraw());
  let truth = { list: [], arrays: {} };
  let shown = null; // {target, arrays}
  const chart = makeChart(panel, id, {
    label: "Micro-Doppler signature; click to move the time cursor",
    drag: (time) => clock.seek(time),
    zoom: { x: zoom.time, y: zoom.doppler },
    page,
    read,
    view: () =>
      shown && {
        x: { limits: zoom.time.limits([clock.start, clock.stop]), name: "time", unit: "s" },
        y: { limits: zoom.doppler.limits(band() ?? edges(levels.image.y)), name: "Doppler", unit: "Hz" },
        second: levels.image.y.second,
      },
    draw,
    drawOver: (context) => drawCursor(context, chart, clock.time),
  });
  if (id === "signature") panel.node.append(parts); // its switches are those of a second signature, too
  return { node: panel.node, showTruth, show, refine: levels.refine, say: panel.say, redraw: levels.repaint, tick: chart.redrawOverlay, destroy: chart.destroy };

  function showTruth({ facts, arrays }) {
    truth = { list: facts.truth ?? [], arrays };
    makeSwitches();
    chart.redraw();
  }

  /** Show a target's signature; null for none. */
  function show(target, arrays) {
    shown = target && { target, arrays };
    panel.heading.textContent = before + title(target);
    levels.show(target?.signature ?? null, target && arrays[target.signature.array]);
  }

  /** The picture is that of the whole track where it is known, or that of one segment. */
  function title(target) {
    if (target?.overview) return "Micro-Doppler signature, all ranges";
    const segment = shownSegment(target);
    if (!segment) return "Micro-Doppler signature";
    const which = target.segments.length > 1 ? `segment ${target.segment + 1} of ${target.segments.length}, ` : "segment ";
    return `Micro-Doppler signature, ${which}${span(segment)}`;
  }

  function chosen() {
    return new Set((state.get("lines") ?? "main-line,segments").split(",").filter(Boolean));
  }

  function makeSwitches() {
    const groups = [...new Set(truth.list.flatMap((one) => one.doppler?.parts ?? []))];
    const lines = groups.map((group) => [group.replaceAll(" ", "-"), group, session.part_colours[group] ?? "#808080"]);
    const whole = lines.every(([key]) => chosen().has(key));
    const every = element("button", { type: "button", onclick: () => choose(lines, !whole) }, whole ? "none" : "all");
    parts.replaceChildren(
      element("legend", {}, "Lines over the signature"),
      ...EXTRAS.map(makeSwitch),
      element("span", { class: "group" }, groups.length ? "truth:" : "no truth in this recording"),
      ...lines.map(makeSwitch),
      ...(groups.length ? [every] : []),
    );
  }

  function makeSwitch([key, words, colour]) {
    const box = element("input", { type: "checkbox", value: key, onchange: () => toggle(key, box.checked) });
    box.checked = chosen().has(key);
    return element("label", {}, box, dot(colour, "swatch"), words);
  }

  function toggle(key, on) {
    const keys = chosen();
    if (on) keys.add(key);
    else keys.delete(key);
    keep(keys);
  }

  function choose(lines, on) {
    const keys = chosen();
    for (const [key] of lines) keys[on ? "add" : "delete"](key);
    keep(keys);
  }

  function keep(keys) {
    state.set({ lines: [...keys].join(",") || "none" });
    makeSwitches();
  }

  function draw(context) {
    levels.draw(context, chart);
    const keys = chosen();
    const own = bodyOf(shown.target, shown.arrays, truth);
    for (const [number, one] of truth.list.entries()) {
      context.globalAlpha = number === own ? 1 : OTHER_BODY;
      if (one.doppler) drawTruth(context, one.doppler, number, keys);
    }
    context.globalAlpha = 1;
    if (keys.has("segments") && shown.target.segments?.length) drawSegments(context, shown.target);
    if (keys.has("main-line")) for (const one of shown.target.main_lines ?? []) drawMainLine(context, one);
  }

  function drawTruth(context, { time, parts: groups, values }, number, keys) {
    const hertz = truth.arrays[values];
    context.setLineDash(DASHES[number % DASHES.length]);
    for (const [row, group] of groups.entries()) {
      if (!keys.has(group.replaceAll(" ", "-"))) continue;
      const stroke = () => drawLine(context, chart, time.n, (n) => [valueAt(time, n), hertz[row * time.n + n]]);
      withEdge(context, session.part_colours[group] ?? "#808080", 1.6, stroke, "rgba(255, 255, 255, 0.4)");
    }
    context.setLineDash([]);
  }

  function drawMainLine(context, { x, values }) {
    const hertz = shown.arrays[values];
    context.setLineDash([6, 4]);
    withEdge(context, MAIN_LINE, 1.6, () =>
      drawLine(context, chart, hertz.length, (n) => [valueAt(x, n), hertz[n]]),
    );
    context.setLineDash([]);
  }

  /** A bar with a number above every segment; the one that the features come from is bright and has its ends drawn. */
  function drawSegments(context, { segments, segment }) {
    const { top, bottom } = chart.box;
    for (const [number, ends] of segments.entries()) {
      const [from, to] = ends.map(chart.x);
      const own = number === (segment ?? number);
      context.globalAlpha = own ? 1 : 0.55;
      const bar = () => drawPath(context, [[from + 1, top + 3], [to - 1, top + 3]]);
      withEdge(context, SEGMENT_COLOUR, own ? 4 : 2.5, bar);
      if (own) {
        for (const at of [from, to]) withEdge(context, SEGMENT_COLOUR, 1, () => drawPath(context, [[at, top], [at, bottom]]));
      }
      if (segments.length > 1) drawText(context, String(number + 1), (from + to) / 2, top + 7, SEGMENT_COLOUR);
    }
    context.globalAlpha = 1;
  }

  function read(time, doppler) {
    const cell = levels.at(time, doppler);
    const { x, y, speed, level } = cell ?? { x: time, y: doppler, speed: "", level: "no column here: a whole CPI must lie in the recording" };
    return `${fixed(x, 3)} s · ${fixed(y, 2)} Hz${speed} · ${level}`;
  }
}
