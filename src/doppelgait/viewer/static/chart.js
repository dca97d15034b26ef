// A chart: axes around a picture, lines over it, a cursor, and the value under the mouse.

import { drawAxes, drawPath, linear } from "./axes.js";
import { makeLayers, themeColours } from "./canvas.js";
import { edges } from "./picture.js";

/** Margins of all charts: the time axes of two panels above each other begin and end in the same columns. */
export const MARGINS = { left: 58, right: 58, top: 4, bottom: 36 };
export const CURSOR = "#ffffff";

/**
 * Chart on a panel's body. `view()` gives `{x, y, second?}` as `drawAxes` takes them (and other `margins`, where they
 * depend on what is shown), or null while there is nothing;
 * `draw(context, chart)` paints inside the frame; `drawOver(context, chart)` what moves. `read(x, y)` gives the text for
 * the mouse at data coordinates; `drag(x)` is called for a click or drag. `zoom` holds the axes (see zoom.js) that the
 * wheel changes, `page` the zoom and the tools of the whole page.
 */
export function makeChart(panel, id, { label, view, draw, drawOver = () => {}, read, drag = null, margins = MARGINS, zoom = {}, page = {} }) {
  let mouse = null;
  let [moving, pressed] = [null, null]; // where the mouse went down to scroll, or to measure
  const chart = { box: null, x: null, y: null, view: null, redraw, redrawOverlay, destroy };
  const layers = makeLayers(panel.body, id, { label, draw: drawBase, drawOverlay });
  const canvas = (chart.canvas = layers.overlay);
  canvas.addEventListener("pointermove", onMove);
  canvas.addEventListener("pointerleave", onLeave);
  canvas.addEventListener("pointerdown", onDown);
  canvas.addEventListener("pointerup", onUp);
  if (zoom.x || zoom.y) {
    canvas.addEventListener("wheel", onWheel, { passive: false });
    canvas.addEventListener("dblclick", () => !tool() && page.zoom.reset());
  }
  return chart;

  function redraw() {
    layers.redraw();
    readOut();
  }

  function redrawOverlay() {
    layers.redrawOverlay();
    if (mouse) readOut();
  }

  function drawBase(context, { width, height }) {
    chart.view = view();
    if (!chart.view) return;
    const { left, top, right, bottom } = chart.view.margins ?? margins;
    const box = { left, top, right: width - right, bottom: height - bottom };
    chart.box = box;
    chart.x = linear(chart.view.x.limits, [box.left, box.right]);
    chart.y = linear(chart.view.y.limits, [box.bottom, box.top]);
    inside(context, () => {
      context.fillStyle = themeColours().line; // where there are no data
      context.fillRect(box.left, box.top, box.right - box.left, box.bottom - box.top);
      draw(context, chart);
    });
    drawAxes(context, box, chart.view, themeColours());
  }

  function drawOverlay(context) {
    if (!chart.view) return;
    inside(context, () => {
      drawOver(context, chart);
      for (const one of page.tools ?? []) one.draw(context, chart);
      if (mouse) drawCross(context);
    });
  }

  function inside(context, paint) {
    const { left, top, right, bottom } = chart.box;
    context.save();
    context.beginPath();
    context.rect(left, top, right - left, bottom - top);
    context.clip();
    paint();
    context.restore();
  }

  function drawCross(context) {
    context.strokeStyle = "rgba(255, 255, 255, 0.45)";
    context.lineWidth = 1;
    drawPath(context, [[chart.box.left, mouse.y], [chart.box.right, mouse.y]]);
    drawPath(context, [[mouse.x, chart.box.top], [mouse.x, chart.box.bottom]]);
  }

  /** The tool that is switched on: it takes the clicks. */
  function tool() {
    return page.tools?.find((one) => one.on);
  }

  function place(event) {
    const { left, top } = canvas.getBoundingClientRect();
    return { x: event.clientX - left, y: event.clientY - top };
  }

  function onMove(event) {
    if (!chart.box) return;
    const at = place(event);
    const { left, right, top, bottom } = chart.box;
    mouse = at.x >= left && at.x <= right && at.y >= top && at.y <= bottom ? at : null;
    if (tool()) tool().move(chart, dataAt(at));
    else if (moving && event.buttons === 1) scroll(at);
    else if (drag && event.buttons === 1 && canvas.hasPointerCapture(event.pointerId)) drag(chart.x.invert(at.x));
    readOut();
    layers.redrawOverlay();
  }

  function onLeave() {
    mouse = null;
    readOut();
    layers.redrawOverlay();
  }

  function onDown(event) {
    if (!chart.box || event.button !== 0) return;
    const at = place(event);
    if (tool()) {
      pressed = at;
      return tool().start(chart, dataAt(at));
    }
    if (event.shiftKey && (zoom.x || zoom.y)) moving = at;
    else if (!drag) return;
    canvas.setPointerCapture(event.pointerId);
    if (!moving) drag(chart.x.invert(at.x));
  }

  /** Two points may also be taken in one go, with the button held. */
  function onUp(event) {
    const at = place(event);
    if (tool() && pressed && Math.hypot(at.x - pressed.x, at.y - pressed.y) > 4) tool().finish(chart, dataAt(at));
    moving = pressed = null;
  }

  function dataAt(at) {
    const { left, right, top, bottom } = chart.box;
    const inside = [Math.min(Math.max(at.x, left), right), Math.min(Math.max(at.y, top), bottom)];
    return [chart.x.invert(inside[0]), chart.y.invert(inside[1])];
  }

  /** What is under the mouse stays there. */
  function scroll(at) {
    zoom.x?.shift(chart.x.invert(moving.x) - chart.x.invert(at.x));
    zoom.y?.shift(chart.y.invert(moving.y) - chart.y.invert(at.y));
    moving = at;
  }

  /** Zoom in x, or in y over its numbers, with alt, or where x cannot be zoomed; scroll with shift. */
  function onWheel(event) {
    if (!chart.box || event.ctrlKey) return;
    event.preventDefault();
    const at = place(event);
    const [x, y] = dataAt(at);
    const beside = at.x < chart.box.left || at.x > chart.box.right;
    const axis = zoom.y && (beside || event.altKey || !zoom.x) ? zoom.y : zoom.x;
    if (!axis) return;
    const sideways = Math.abs(event.deltaX) > Math.abs(event.deltaY);
    const turned = Math.min(Math.max(sideways ? event.deltaX : event.deltaY, -300), 300);
    if (event.shiftKey || sideways) axis.shift((turned / 1000) * (axis.shown[1] - axis.shown[0]) * (axis === zoom.y ? -1 : 1));
    else axis.zoom(Math.exp(0.0015 * turned), axis === zoom.y ? y : x);
  }

  function readOut() {
    panel.hover.textContent = mouse && chart.view ? read(chart.x.invert(mouse.x), chart.y.invert(mouse.y)) : "";
  }

  function destroy() {
    layers.destroy();
  }
}

/** Draw a painted picture (a canvas with one pixel a cell) where its axes lie. */
export function drawPicture(context, chart, picture, image) {
  const [x0, x1] = edges(image.x).map(chart.x);
  const [y0, y1] = edges(image.y).map(chart.y);
  // cells larger than a pixel keep their edges; smaller ones are averaged
  context.imageSmoothingEnabled = picture.width > x1 - x0;
  context.drawImage(picture, x0, y1, x1 - x0, y0 - y1);
}

/** A line through points in data coordinates; it breaks where a value is unknown. */
export function drawLine(context, chart, count, pointAt) {
  let open = false;
  context.beginPath();
  for (let n = 0; n < count; n += 1) {
    const [x, y] = pointAt(n);
    if (!Number.isFinite(y)) {
      open = false;
      continue;
    }
    if (open) context.lineTo(chart.x(x), chart.y(y));
    else context.moveTo(chart.x(x), chart.y(y));
    open = true;
  }
  context.stroke();
}

/** Stroke twice, dark (or as `edge` says) and wide below, so that a line is seen on any colour. */
export function withEdge(context, colour, width, stroke, edge = "rgba(0, 0, 0, 0.55)") {
  context.lineWidth = width + 1.4;
  context.strokeStyle = edge;
  stroke();
  context.lineWidth = width;
  context.strokeStyle = colour;
  stroke();
}

/** The time cursor. */
export function drawCursor(context, chart, time) {
  const at = Math.round(chart.x(time)) + 0.5;
  withEdge(context, CURSOR, 1.5, () => drawPath(context, [[at, chart.box.top], [at, chart.box.bottom]]));
}
