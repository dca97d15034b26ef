// Range-Doppler map of the coherent processing interval at the cursor, with the gate.

import { getPayload, isAborted } from "./api.js";
import { drawPicture, makeChart, withEdge } from "./chart.js";
import { makeBar, makeTones } from "./levels.js";
import { cellAt, edges, levelDb, paint, valueAt } from "./picture.js";
import { gateAt, gateColour } from "./range_time.js";
import { element, fixed, makePanel, showError } from "./ui.js";

const CHUNK = 32;
const AHEAD = 2; // chunks asked for before the cursor reaches them

/** Levels of one frame from 3 dB below its median to its strongest cell, 20 to 40 dB; an even sample gives the median. */
function ownLevels(image, codes) {
  const step = (image.db[1] - image.db[0]) / 65535;
  const every = Math.max(1, Math.floor(codes.length / 2000));
  const some = codes.filter((_, n) => n % every === 0).sort();
  const high = image.db[0] + codes.reduce((a, b) => Math.max(a, b), 0) * step;
  const median = image.db[0] + some[some.length >> 1] * step;
  return [high - Math.min(Math.max(high - median + 3, 20), 40), high];
}

export function makeRangeDoppler(page) {
  const { session, clock, widest, zoom } = page;
  const panel = makePanel("range-doppler", `${page.before}Range-Doppler`);
  const picture = element("canvas");
  const bar = makeBar(panel.tools, session);
  const tonesOf = makeTones(session);
  let reference = null;
  let image = null; // facts of all frames: x range, y Doppler, time
  let chunks = new Map();
  let plotted = null;
  let targets = null;
  const chart = makeChart(panel, "range-doppler", {
    label: "Range-Doppler map at the time cursor",
    zoom: { y: zoom.doppler },
    page,
    read,
    view: () =>
      image && {
        x: { limits: edges(image.x), name: "range", unit: "m" },
        y: { limits: zoom.doppler.limits(widest() ?? edges(image.y)), name: "Doppler", unit: "Hz" },
        second: image.y.second,
      },
    draw,
    drawOver,
  });
  return { node: panel.node, load, showTargets, redraw, tick, destroy: chart.destroy, step: () => image?.time.step };

  /** Take the frames of another run; the picture of the old one stays until the first of them has come. */
  async function load(runReference, reason) {
    reference = runReference;
    if (reason) return nothing(reason);
    const fresh = new Map();
    try {
      const { facts } = await ask(0, runReference, fresh);
      if (reference !== runReference) return;
      if (!facts.frames) return nothing(facts.reason);
      chunks = fresh;
      image = { ...facts, x: facts.range, y: facts.doppler };
      plotted = null;
      panel.say(null);
      bar(image);
      tick();
      chart.redraw();
    } catch (error) {
      if (reference === runReference && !isAborted(error)) nothing(error.message);
    }
  }

  function nothing(reason) {
    image = null;
    bar(null);
    panel.say(reason);
    chart.redraw();
  }

  /** Frames of a chunk, asked for once. */
  function ask(number, of, into) {
    const answer = { codes: null };
    into.set(number, answer);
    const params = { ...of, from: number * CHUNK, count: CHUNK };
    return getPayload("api/range-doppler", params, { key: null }).then((payload) => {
      answer.codes = payload.arrays[payload.facts.frames];
      return payload;
    });
  }

  function frameAt(time) {
    const { first, step, n } = image.time;
    return Math.min(Math.max(Math.round((time - first) / step), 0), n - 1);
  }

  /** Ask for the chunk of a frame and, while playing, for those that the cursor reaches next. */
  function fetchFor(frame) {
    const mine = chunks;
    const count = Math.ceil(image.time.n / CHUNK);
    for (let n = 0; n <= (clock.playing ? AHEAD : 0); n += 1) {
      const number = (Math.floor(frame / CHUNK) + n) % count;
      if (mine.has(number)) continue;
      ask(number, reference, mine).then(() => mine === chunks && tick(), showError);
    }
  }

  function showTargets(next) {
    targets = next;
    chart.redraw();
  }

  function tick() {
    if (!image) return;
    const frame = frameAt(clock.time);
    fetchFor(frame);
    if (frame !== plotted && codesOf(frame)) {
      plotted = frame;
      redraw();
    } else chart.redrawOverlay();
  }

  function codesOf(frame) {
    const cells = image.x.n * image.y.n;
    const from = (frame % CHUNK) * cells;
    return chunks.get(Math.floor(frame / CHUNK))?.codes?.subarray(from, from + cells);
  }

  function redraw() {
    if (image && plotted !== null) {
      const codes = codesOf(plotted);
      const scaled = { ...image, shown_db: ownLevels(image, codes) };
      paint(picture, codes, [image.x.n, image.y.n], tonesOf(scaled));
      bar(scaled);
    } else bar(image);
    chart.redraw();
  }

  function draw(context) {
    if (plotted !== null) drawPicture(context, chart, picture, image);
  }

  function drawOver(context) {
    for (const [number, target] of (targets?.targets ?? []).entries()) {
      const gate = gateAt(target, targets.arrays, clock.time);
      if (gate) drawGate(context, gate, number);
    }
    if (plotted === null) return;
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "right";
    const label = `CPI at ${fixed(valueAt(image.time, plotted), 2)} s`;
    const { left, right, top } = chart.box;
    const width = context.measureText(label).width + 10;
    const end = isGated(right - width) ? left + width : right;
    context.fillStyle = "rgba(0, 0, 0, 0.6)";
    context.fillRect(end - width, top, width, 20);
    context.fillStyle = "#fff";
    context.fillText(label, end - 5, top + 14);
  }

  /** Whether the gate of a target at the cursor reaches beyond a pixel, to the right. */
  function isGated(from) {
    const gates = (targets?.targets ?? []).map((target) => gateAt(target, targets.arrays, clock.time));
    return gates.some((gate) => gate && chart.x(gate[1]) > from);
  }

  function drawGate(context, [low, high], number) {
    const [from, to] = [chart.x(low), chart.x(high)];
    const { top, bottom } = chart.box;
    context.globalAlpha = number === targets.selected ? 1 : 0.6;
    withEdge(context, gateColour(number), number === targets.selected ? 1.6 : 1, () =>
      context.strokeRect(from, top + 2, to - from, bottom - top - 4),
    );
    context.globalAlpha = 1;
  }

  function read(range, doppler) {
    const [column, row] = [cellAt(image.x, range), cellAt(image.y, doppler)];
    const codes = plotted === null ? null : codesOf(plotted);
    if (column === null || row === null || !codes) return `${fixed(range, 3)} m · ${fixed(doppler, 2)} Hz`;
    const hertz = valueAt(image.y, row);
    const speed = image.y.second ? ` · ${fixed(hertz * image.y.second.scale, 3)} m/s` : "";
    const level = levelDb(image, codes, column, row);
    const at = `${fixed(valueAt(image.time, plotted), 3)} s · ${fixed(valueAt(image.x, column), 3)} m`;
    return `${at} · ${fixed(hertz, 2)} Hz${speed} · ${fixed(level, 2)} ${image.unit}`;
  }
}
