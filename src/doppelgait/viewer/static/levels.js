// Colours of levels: the map and the range of decibels that the reader has chosen, and the bar that shows both.

import { drawPicture } from "./chart.js";
import { cellAt, colourTable, levelDb, paint, tones, valueAt } from "./picture.js";
import * as state from "./state.js";
import { element, fixed } from "./ui.js";

const tables = new Map();

/** Colour table in force. */
export function table(session) {
  const chosen = state.get("map");
  const name = chosen in session.colour_maps ? chosen : session.default_map;
  if (!tables.has(name)) tables.set(name, colourTable(session.colour_maps[name]));
  return tables.get(name);
}

/**
 * Levels in dB at the ends of the colours: those of the picture, or as chosen relative to its upper one. Relative,
 * because pictures of one page have different references.
 */
function limits(image) {
  const [low, high] = [state.getNumber("lo"), state.getNumber("hi")];
  const top = image.shown_db[1];
  const chosen = [low === null ? image.shown_db[0] : top + low, top + (high ?? 0)];
  return chosen[1] - chosen[0] >= 1 ? chosen : [chosen[1] - 1, chosen[1]];
}

/**
 * Picture of levels in a panel: `show(image, codes)` for the whole of it, `refine(image, codes)` for a part on a finer
 * grid, in the colours of the whole; `repaint()` in the colours in force. Each ends with `redraw()`.
 */
export function makeLevels(panel, session, redraw) {
  const bar = makeBar(panel.tools, session);
  let layers = []; // {image, codes, canvas, key}
  const levels = { image: null, codes: null, show, refine, repaint, draw, at };
  return levels;

  function show(image, codes) {
    layers = image ? [{ image, codes, canvas: layers[0]?.canvas ?? element("canvas"), key: "" }] : [];
    Object.assign(levels, { image, codes });
    repaint();
  }

  function refine(image, codes) {
    layers.length = Math.min(layers.length, 1);
    if (image && layers.length) layers.push({ image: { ...image, shown_db: levels.image.shown_db }, codes, canvas: element("canvas"), key: "" });
    repaint();
  }

  function repaint() {
    bar(levels.image);
    for (const layer of layers) {
      const shown = [limits(layer.image), table(session)];
      const key = [...shown[0], state.get("map")].join();
      if (layer.key !== key) paint(layer.canvas, layer.codes, [layer.image.x.n, layer.image.y.n], tones(layer.image.db, ...shown));
      layer.key = key;
    }
    redraw();
  }

  function draw(context, chart) {
    for (const { canvas, image } of layers) drawPicture(context, chart, canvas, image);
  }

  /** Middle of the cell at a place, and its level as text, from the finest picture there; null beside all. */
  function at(x, y) {
    for (const { image, codes } of layers.toReversed()) {
      const [column, row] = [cellAt(image.x, x), cellAt(image.y, y)];
      if (column === null || row === null) continue;
      const { second } = image.y;
      const hertz = valueAt(image.y, row);
      const speed = second ? ` · ${fixed(hertz * second.scale, 3)} ${second.unit}` : "";
      return { x: valueAt(image.x, column), y: hertz, speed, level: `${fixed(levelDb(image, codes, column, row), 2)} ${image.unit}` };
    }
    return null;
  }
}

/** Colour bar with its two levels and the unit, to stand in a panel's header. */
function makeBar(holder, session) {
  const canvas = element("canvas", { class: "bar", width: 256, height: 1, "aria-hidden": "true" });
  const [low, high] = [element("span", {}), element("span", {})];
  const node = element("div", { class: "colour-bar" }, low, canvas, high);
  holder.append(node);
  return (image) => {
    node.hidden = !image;
    if (!image) return;
    const shown = limits(image);
    low.textContent = fixed(shown[0], 0);
    high.textContent = `${fixed(shown[1], 0)} ${image.unit}`;
    const context = canvas.getContext("2d");
    const strip = context.createImageData(256, 1);
    new Uint32Array(strip.data.buffer).set(table(session));
    context.putImageData(strip, 0, 0);
  };
}
