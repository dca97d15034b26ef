// Range-Doppler map of the coherent processing interval at the cursor, with the gate.

import { getPayload, isAborted } from "./api.js";
import { makeChart, withEdge } from "./chart.js";
import { makeLevels } from "./levels.js";
import { edges, valueAt } from "./picture.js";
import { gateAt, gateColour } from "./range_time.js";
import { fixed, makePanel, showError } from "./ui.js";

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
  const levels = makeLevels(panel, session, () => chart.redraw());
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
  return { node: panel.node, load, showTargets, redraw: levels.repaint, tick, destroy: chart.destroy };

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
      tick();
      chart.redraw();
    } catch (error) {
      if (reference === runReference && !isAborted(error)) nothing(error.message);
    }
  }

  function nothing(reason) {
    image = null;
    levels.show(null);
    panel.say(reason);
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
    const codes = codesOf(frame);
    if (frame !== plotted && codes) {
      plotted = frame;
      panel.heading.textContent = `${page.before}Range-Doppler at ${fixed(valueAt(image.time, frame), 2)} s`;
      levels.show({ ...image, shown_db: ownLevels(image, codes) }, codes);
    } else chart.redrawOverlay();
  }

  function codesOf(frame) {
    const cells = image.x.n * image.y.n;
    const from = (frame % CHUNK) * cells;
    return chunks.get(Math.floor(frame / CHUNK))?.codes?.subarray(from, from + cells);
  }

  function draw(context) {
    levels.draw(context, chart);
  }

  function drawOver(context) {
    for (const [number, target] of (targets?.targets ?? []).entries()) {
      const gate = gateAt(target, targets.arrays, clock.time);
      if (gate) drawGate(context, gate, number);
    }
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
    const cell = levels.at(range, doppler);
    if (plotted === null || !cell) return `${fixed(range, 3)} m · ${fixed(doppler, 2)} Hz`;
    return `${fixed(valueAt(image.time, plotted), 3)} s · ${fixed(cell.x, 3)} m · ${fixed(cell.y, 2)} Hz${cell.speed} · ${cell.level}`;
  }
}
