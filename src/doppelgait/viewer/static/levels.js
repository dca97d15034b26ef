// Colours of levels: the map and the range of decibels that the reader has chosen, and the bar that shows both.

import { colourTable, tones } from "./picture.js";
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
export function limits(image) {
  const [low, high] = [state.getNumber("lo"), state.getNumber("hi")];
  const top = image.shown_db[1];
  const chosen = [low === null ? image.shown_db[0] : top + low, top + (high ?? 0)];
  return chosen[1] - chosen[0] >= 1 ? chosen : [chosen[1] - 1, chosen[1]];
}

/** Maker of the pixels of a picture; it computes them again only when something has changed. */
export function makeTones(session) {
  let key = null;
  let pixels = null;
  return (image) => {
    const [shown, colours] = [limits(image), table(session)];
    const wanted = [...image.db, ...shown];
    if (!key || key.colours !== colours || key.wanted.some((value, n) => value !== wanted[n])) {
      key = { wanted, colours };
      pixels = tones(image.db, shown, colours);
    }
    return pixels;
  };
}

/** Colour bar with its two levels and the unit, to stand in a panel's header. */
export function makeBar(holder, session) {
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
