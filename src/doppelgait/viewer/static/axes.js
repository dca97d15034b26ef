// Scales, ticks and axes of a chart.

import { fixed } from "./ui.js";

export const FONT = "11px system-ui, sans-serif";

/** Linear scale from data to pixels, with `invert` back. */
export function linear([low, high], [from, to]) {
  const slope = (to - from) / (high - low || 1);
  const scale = (value) => from + (value - low) * slope;
  scale.invert = (pixel) => low + (pixel - from) / slope;
  return scale;
}

/** Round values between two ends, about `most` of them, and the decimals they need. */
export function ticks(low, high, most) {
  const rough = (high - low) / Math.max(most, 1);
  if (!(rough > 0)) return { values: [low], decimals: 1 };
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((candidate) => candidate >= rough * 0.72);
  const values = [];
  for (let n = Math.ceil(low / step - 1e-6); n <= high / step + 1e-6; n += 1) values.push(n * step);
  return { values, decimals: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

/**
 * Frame, ticks and names around `box` = {left, top, right, bottom}. `x` and `y` are {limits, name, unit, labels?};
 * `second` is {scale, name, unit} of the axis on the right: its value is scale times that of y.
 */
export function drawAxes(context, box, { x, y, second }, colours) {
  context.save();
  context.font = FONT;
  context.lineWidth = 1;
  context.strokeStyle = colours.faint;
  context.fillStyle = colours.text;
  context.strokeRect(box.left - 0.5, box.top - 0.5, box.right - box.left + 1, box.bottom - box.top + 1);
  drawX(context, box, x);
  drawY(context, box, y, { at: box.left, outwards: -1, name: box.left - 51 });
  if (second) {
    const limits = y.limits.map((value) => value * second.scale);
    drawY(context, box, { ...second, limits }, { at: box.right, outwards: 1, name: box.right + 51 });
  }
  context.restore();
}

function drawX(context, box, { limits, name, unit, labels = true }) {
  const scale = linear(limits, [box.left, box.right]);
  const { values, decimals } = ticks(...limits, (box.right - box.left) / 70);
  context.textAlign = "center";
  context.textBaseline = "top";
  for (const value of values) {
    const at = Math.round(scale(value)) + 0.5;
    drawPath(context, [[at, box.bottom], [at, box.bottom + 4]]);
    if (labels) context.fillText(fixed(value, decimals), at, box.bottom + 6);
  }
  if (labels) context.fillText(`${name} (${unit})`, (box.left + box.right) / 2, box.bottom + 20);
}

function drawY(context, box, { limits, name, unit }, { at, outwards, name: nameAt }) {
  const scale = linear(limits, [box.bottom, box.top]);
  const height = box.bottom - box.top;
  const { values, decimals } = ticks(...limits, Math.max(height / 36, Math.min(height / 24, 4)));
  context.textAlign = outwards < 0 ? "right" : "left";
  context.textBaseline = "middle";
  for (const value of values) {
    const y = Math.round(scale(value)) + 0.5;
    drawPath(context, [[at, y], [at + 4 * outwards, y]]);
    context.fillText(fixed(value, decimals), at + 7 * outwards, y);
  }
  context.save();
  context.translate(nameAt, (box.top + box.bottom) / 2);
  context.rotate(-Math.PI / 2);
  context.textAlign = "center";
  context.fillText(`${name} (${unit})`, 0, 0);
  context.restore();
}

/** A line through points in pixels. */
export function drawPath(context, [first, ...others]) {
  context.beginPath();
  context.moveTo(...first);
  for (const point of others) context.lineTo(...point);
  context.stroke();
}

/** A text with an edge, so that it is read on any colour. */
export function drawText(context, words, x, y, colour, edge = "rgba(0, 0, 0, 0.7)") {
  context.font = FONT;
  context.textAlign = "center";
  context.textBaseline = "top";
  context.lineWidth = 3;
  context.strokeStyle = edge;
  context.strokeText(words, x, y);
  context.fillStyle = colour;
  context.fillText(words, x, y);
}
