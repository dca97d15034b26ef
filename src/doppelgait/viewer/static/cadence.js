// Cadence-velocity diagram and, on the same cadence axis, the cadence spectrum with its marked peaks.

import { drawLine, makeChart, MARGINS, withEdge } from "./chart.js";
import { themeColours } from "./canvas.js";
import { drawPath, drawText } from "./axes.js";
import { makeLevels } from "./levels.js";
import { cellAt, edges, valueAt } from "./picture.js";
import * as state from "./state.js";
import { element, fixed, makePanel, words } from "./ui.js";

const TITLE = "Cadence-velocity diagram";
const PEAK = "#56b4e9";
const FROM_LINE = "from main line"; // what the Doppler axis counts from where the signature was aligned
const NAMES = { f_mu: "f", "2nd": "2f", "3rd": "3f" };

export function makeCadence(page) {
  const { session, band, before } = page;
  const panel = makePanel("cadence", before + TITLE);
  const below = makeBelow(panel);
  const levels = makeLevels(panel, session, () => [map, spectrum].forEach((chart) => chart.redraw()));
  let shown = null; // {image, codes, spectrum, arrays, own}
  const map = makeChart(panel, "cadence", {
    label: "Cadence-velocity diagram: cadence against Doppler",
    margins: { ...MARGINS, bottom: 10 }, // the spectrum below has the same cadence axis, with its numbers
    read: readMap,
    page,
    view: () =>
      shown && {
        x: { limits: [0, reach()], name: "cadence", unit: "Hz", labels: false },
        y: { limits: dopplerLimits(), name: shown.own ? FROM_LINE : "Doppler", unit: "Hz" },
        second: shown.own && shown.image.y.second ? { ...shown.image.y.second, name: FROM_LINE } : shown.image.y.second,
      },
    draw: drawMap,
  });
  const spectrum = makeChart(below, "spectrum", {
    label: "Cadence spectrum with its peaks",
    read: readSpectrum,
    page,
    view: () =>
      shown?.spectrum && {
        x: { limits: [0, reach()], name: "cadence", unit: "Hz" },
        y: { limits: spectrumLimits(), name: "level", unit: "dB" },
      },
    draw: drawSpectrum,
  });
  return { node: panel.node, show, say: panel.say, redraw: levels.repaint, tick, destroy };

  function show(target, arrays) {
    shown = target && {
      image: target.cadence_map,
      codes: arrays[target.cadence_map.array],
      spectrum: target.cadence_spectrum,
      arrays,
      own: target.aligned ? target.cadence_map.band_hz : null,
    };
    panel.heading.textContent = before + (shown?.own ? `${TITLE} about the main line` : TITLE);
    levels.show(shown?.image ?? null, shown?.codes);
  }

  function dopplerLimits() {
    const whole = edges(shown.image.y);
    if (!shown.own) return band() ?? whole;
    return state.get("band") === "all" ? whole : shown.own;
  }

  /** Right end of the cadence axis: what shows three harmonics, 8 Hz or more. */
  function reach() {
    const peaks = shown.spectrum?.peaks ?? [];
    const wanted = Math.max(8, 3.6 * (peaks.length ? peaks[0].hz : 0));
    return Math.min(wanted, edges(shown.image.x)[1]);
  }

  function inReach() {
    const { x, db } = shown.spectrum;
    const count = Math.min(x.n, Math.floor((reach() - x.first) / x.step) + 2);
    return shown.arrays[db].subarray(0, count);
  }

  function spectrumLimits() {
    const known = inReach().filter(Number.isFinite);
    if (!known.length) return [-40, 0];
    const top = known.reduce((a, b) => Math.max(a, b), -Infinity);
    const low = known.reduce((a, b) => Math.min(a, b), Infinity);
    const span = Math.min(Math.max(top - low, 10), 60);
    return [top - span - 1, top + 0.3 * span];
  }

  function drawMap(context) {
    levels.draw(context, map);
    for (const peak of shown.spectrum?.peaks ?? []) drawTick(context, peak);
  }

  function drawTick(context, { hz, name }) {
    const at = map.x(hz);
    withEdge(context, PEAK, 1.5, () => drawPath(context, [[at, map.box.top], [at, map.box.top + 9]]));
    drawText(context, nameOf(name), at, map.box.top + 12, PEAK);
  }

  function nameOf(peak) {
    return NAMES[peak] ?? words(peak);
  }

  function drawSpectrum(context) {
    const colours = themeColours();
    context.fillStyle = colours.plot;
    context.fillRect(0, 0, spectrum.box.right, spectrum.box.bottom);
    const values = inReach();
    const { x, peaks } = shown.spectrum;
    context.strokeStyle = colours.text;
    context.lineWidth = 1.2;
    drawLine(context, spectrum, values.length, (n) => [valueAt(x, n), values[n]]);
    for (const { hz, name } of peaks) {
      const at = spectrum.x(hz);
      const cell = cellAt(x, hz);
      const top = cell === null ? spectrum.box.top : spectrum.y(values[Math.min(cell, values.length - 1)]);
      context.strokeStyle = colours.accent;
      context.setLineDash([2, 2]);
      drawPath(context, [[at, spectrum.box.bottom], [at, top]]);
      context.setLineDash([]);
      context.fillStyle = colours.accent;
      context.beginPath();
      context.arc(at, top, 3, 0, 2 * Math.PI);
      context.fill();
      drawText(context, nameOf(name), at, Math.max(top - 18, spectrum.box.top + 1), colours.accent, colours.plot);
    }
  }

  function readMap(cadence, doppler) {
    const cell = levels.at(cadence, doppler);
    if (!cell) return `${fixed(cadence, 3)} Hz · ${fixed(doppler, 2)} Hz`;
    const where = shown.own ? ` ${FROM_LINE}` : "";
    return `cadence ${fixed(cell.x, 3)} Hz · ${fixed(cell.y, 2)} Hz${cell.speed}${where} · ${cell.level}`;
  }

  function readSpectrum(cadence) {
    const { x, db } = shown.spectrum;
    const cell = cellAt(x, cadence);
    if (cell === null) return `${fixed(cadence, 3)} Hz`;
    return `cadence ${fixed(valueAt(x, cell), 3)} Hz · ${fixed(shown.arrays[db][cell], 2)} dB`;
  }

  function tick() {
    for (const chart of [map, spectrum]) chart.redrawOverlay();
  }

  function destroy() {
    map.destroy();
    spectrum.destroy();
  }
}

/** A second plot in the panel, for the spectrum, with its own read-out in the same header. */
function makeBelow(panel) {
  const hover = element("output", { id: "hover-spectrum", class: "hover" });
  const [body, top] = [element("div", { class: "plot spectrum" }), element("div", { class: "plot" })];
  panel.hover.after(hover);
  panel.body.className = "stacked";
  panel.body.append(top, body);
  panel.body = top;
  return { body, hover };
}
