// What is shown, as files: the panels as a picture (PNG), the features as a table (CSV).

import { featuresOf } from "./features.js";
import { shownSegment } from "./ui.js";

const TEXTS = "h2, .colour-bar span, th, td, .flags li, .empty, .parts label:has(:checked), .keys > span";

const TITLE_PX = 26; // height of the line with the names of the recordings

/** Draw the panels of a page with their canvases and texts below a title, and save that; the mouse leaves no mark in it. */
export async function savePicture(panels, name, title) {
  for (const overlay of panels.querySelectorAll(".overlay")) overlay.dispatchEvent(new PointerEvent("pointerleave"));
  await new Promise(requestAnimationFrame); // the overlays are drawn again before
  const ratio = Math.max(window.devicePixelRatio || 1, 2);
  const outer = panels.getBoundingClientRect();
  const canvas = Object.assign(document.createElement("canvas"), {
    width: Math.ceil(outer.width * ratio), height: Math.ceil((outer.height + TITLE_PX) * ratio),
  });
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  context.translate(-outer.left, TITLE_PX - outer.top);
  const page = getComputedStyle(document.body);
  context.fillStyle = page.backgroundColor;
  context.fillRect(outer.left, outer.top - TITLE_PX, outer.width, outer.height + TITLE_PX);
  context.fillStyle = page.color;
  context.font = `600 14px ${page.fontFamily}`;
  context.textBaseline = "middle";
  context.fillText(title, outer.left + 8, outer.top - TITLE_PX / 2);
  for (const panel of panels.querySelectorAll(".panel")) {
    const { left, top, width, height } = panel.getBoundingClientRect();
    context.fillStyle = getComputedStyle(panel).backgroundColor;
    context.fillRect(left, top, width, height);
    for (const one of panel.querySelectorAll("canvas")) drawCanvas(context, one);
    for (const one of panel.querySelectorAll(TEXTS)) drawText(context, one);
  }
  const blob = await new Promise((done) => { canvas.toBlob(done, "image/png"); });
  download(blob, `${name}.png`);
}

function drawCanvas(context, canvas) {
  const { left, top, width, height } = canvas.getBoundingClientRect();
  if (width > 1 && height > 0 && canvas.width) context.drawImage(canvas, left, top, width, height);
}

function drawText(context, node) {
  const { left, right, top, bottom, width } = node.getBoundingClientRect();
  const words = node.textContent.trim();
  if (!words || !width || node.closest("details:not([open])")) return;
  const style = getComputedStyle(node);
  const fromRight = style.textAlign === "right";
  context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
  const swatch = node.querySelector(".swatch");
  if (swatch) drawSwatch(context, swatch);
  context.fillStyle = style.color;
  context.textAlign = fromRight ? "right" : "left";
  context.textBaseline = "middle";
  const edge = (side) => Number.parseFloat(style[`padding${side}`]) || 0;
  const start = swatch ? swatch.getBoundingClientRect().right + 3 : left + edge("Left");
  context.fillText(words, fromRight ? right - edge("Right") : start, (top + bottom) / 2);
}

/** Colour of a line before its name; the words have the colour of the other texts, which can be read on the panel. */
function drawSwatch(context, node) {
  const { left, top, width, height } = node.getBoundingClientRect();
  context.fillStyle = getComputedStyle(node).backgroundColor;
  context.fillRect(left, top, width, height);
}

/** Features of all targets that are shown, one row each: `runs` are {name, targets}; numbers are written in full. */
export function saveTable(runs, session, name) {
  const rows = [["recording", "target", "class", "gate", "start_s", "stop_s", "feature", "value", "standard_deviation", "unit", "truth"]];
  for (const { name, targets } of runs) {
    for (const target of targets) {
      const [start, stop] = shownSegment(target) ?? ["", ""];
      for (const { key, value, deviation, unit, truth } of featuresOf(target, session)) {
        rows.push([name, target.number, target.label, target.gate, start, stop, key, value, deviation, unit, truth]);
      }
    }
  }
  download(new Blob([csvOf(rows)], { type: "text/csv" }), `${name}.csv`);
}

export function csvOf(rows) {
  return rows.map((row) => row.map(cell).join(",")).join("\r\n") + "\r\n";
}

/** A text that a spreadsheet could run as a formula begins with an apostrophe; so does a text that begins with one. */
function cell(value) {
  const runs = typeof value === "string" && /^['=+\-@\t\r]/.test(value);
  const text = runs ? `'${value}` : String(value ?? "");
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** Give a file to the reader. */
export function download(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
