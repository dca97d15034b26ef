// Canvases that know their size: a base layer that is drawn seldom, and an overlay for what moves.

const NAMES = ["text", "faint", "line", "plot", "accent", "panel"];
let colours = null;
const themed = new Set();

/** Colours of the theme in force, read from the style sheet. */
export function themeColours() {
  if (!colours) {
    const style = getComputedStyle(document.documentElement);
    colours = Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }
  return colours;
}

/** Draw all canvases again: the theme has changed. */
export function refreshTheme() {
  colours = null;
  for (const redraw of [...themed]) redraw();
}

/**
 * Two canvases on top of each other in `holder`, as large as it. `draw(context, size)` and `drawOverlay(context, size)`
 * work in CSS pixels; they run at the next frame after `redraw()` or `redrawOverlay()`, once however often asked for.
 */
export function makeLayers(holder, id, { label, draw, drawOverlay = () => {} }) {
  const base = Object.assign(document.createElement("canvas"), { id: `canvas-${id}` });
  const overlay = Object.assign(document.createElement("canvas"), { id: `canvas-${id}-overlay`, className: "overlay" });
  base.setAttribute("role", "img");
  base.setAttribute("aria-label", label);
  overlay.setAttribute("aria-hidden", "true");
  holder.append(base, overlay);
  const size = { width: 0, height: 0 };
  const wanted = new Set();
  let frame = null;
  const layers = { base, overlay, size, redraw, redrawOverlay, destroy };
  const observer = new ResizeObserver(fit);
  observer.observe(holder);
  themed.add(redraw);
  return layers;

  function fit() {
    const ratio = window.devicePixelRatio || 1;
    const { width, height } = holder.getBoundingClientRect();
    Object.assign(size, { width, height });
    for (const canvas of [base, overlay]) {
      canvas.width = Math.max(1, Math.round(width * ratio));
      canvas.height = Math.max(1, Math.round(height * ratio));
    }
    render("base", "overlay"); // at once: a resized canvas is blank until it is drawn
  }

  function redraw() {
    ask("base", "overlay");
  }

  function redrawOverlay() {
    ask("overlay");
  }

  function ask(...names) {
    for (const name of names) wanted.add(name);
    frame ??= requestAnimationFrame(() => render(...wanted));
  }

  function render(...names) {
    cancelAnimationFrame(frame);
    frame = null;
    wanted.clear();
    if (size.width < 2 || size.height < 2) return;
    if (names.includes("base")) drawOn(base, draw);
    if (names.includes("overlay")) drawOn(overlay, drawOverlay);
  }

  function drawOn(canvas, paintOn) {
    const context = canvas.getContext("2d");
    const ratio = canvas.width / size.width;
    context.save(); // what one drawing sets is not to be found by the next
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, size.width, size.height);
    paintOn(context, size);
    context.restore();
  }

  function destroy() {
    observer.disconnect();
    cancelAnimationFrame(frame);
    themed.delete(redraw);
    base.remove();
    overlay.remove();
  }
}
