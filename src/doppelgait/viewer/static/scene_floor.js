// What stands still in the scene: floor, range rings, radar; and the gate on the floor.

import { bounds } from "./view3d.js";

const SECTOR = (60 * Math.PI) / 180; // half width of rings and gate about the antenna's direction
const STEP = Math.PI / 90;
const NARROWEST = 2; // m of floor

function path(context, camera, points) {
  let open = false;
  context.beginPath();
  for (const point of points) {
    const place = camera.project(point);
    if (place && open) context.lineTo(place.x, place.y);
    else if (place) context.moveTo(place.x, place.y);
    open = Boolean(place);
  }
}

/** Floor of the scene: whole metres around everything in it. */
export function floorOf({ corners }) {
  const [low, high] = bounds(corners);
  const ends = (axis) => {
    const [from, to] = [Math.floor(low[axis] - 0.25), Math.ceil(high[axis] + 0.25)];
    const missing = Math.max(0, Math.ceil((NARROWEST - (to - from)) / 2));
    return [from - missing, to + missing];
  };
  return { x: ends(0), y: ends(1) };
}

export function drawFloor(context, camera, scene, colours) {
  const { x, y } = scene.floor;
  context.strokeStyle = colours.line;
  context.lineWidth = 1;
  for (let at = x[0]; at <= x[1]; at += 1) strokePath(context, camera, [[at, y[0], 0], [at, y[1], 0]]);
  for (let at = y[0]; at <= y[1]; at += 1) strokePath(context, camera, [[x[0], at, 0], [x[1], at, 0]]);
}

export function strokePath(context, camera, points) {
  path(context, camera, points);
  context.stroke();
}

/** Draw something on the floor only: it ends where the floor does. */
export function onFloor(context, camera, { floor: { x, y } }, paint) {
  context.save();
  path(context, camera, [[x[0], y[0], 0], [x[1], y[0], 0], [x[1], y[1], 0], [x[0], y[1], 0]]);
  context.closePath();
  context.clip();
  paint();
  context.restore();
}

/**
 * Texts of the floor, the rings and the radar, after everything else: none of them crosses a body. `places` are the
 * points of the bodies in pixels; a text moves to another of its places where a body is, or is left out.
 */
export function drawLabels(context, camera, scene, { places, colours }) {
  const blocked = bodiesOf(places);
  const labels = [radarLabel(context, camera, scene, colours), ...ringLabels(camera, scene, colours), ...metreLabels(camera, scene, colours)];
  for (const { words, at, colour } of labels) {
    const free = at.map((one) => boxOf(context, words, one)).find((box) => box && !blocked.some((other) => meet(box, other)));
    if (!free) continue;
    context.textAlign = "left";
    context.textBaseline = "middle";
    context.fillStyle = colour;
    context.fillText(words, free.left, (free.top + free.bottom) / 2);
    blocked.push(free); // nor do two texts
  }
}

const ROOM = 6; // pixels around a body and a text

/** Boxes around the points of every body. */
function bodiesOf(places) {
  const boxes = new Map();
  for (const { x, y, label, body } of places) {
    const key = body ?? label;
    const box = boxes.get(key) ?? { left: Infinity, right: -Infinity, top: Infinity, bottom: -Infinity };
    boxes.set(key, {
      left: Math.min(box.left, x - ROOM), right: Math.max(box.right, x + ROOM),
      top: Math.min(box.top, y - 2 * ROOM), bottom: Math.max(box.bottom, y + ROOM),
    });
  }
  return [...boxes.values()];
}

/** Box of a text about a place in pixels, moved into the picture where its place is in it; null outside. */
function boxOf(context, words, place) {
  if (!place) return null;
  const [half, width] = [context.measureText(words).width / 2 + 2, context.canvas.clientWidth];
  if (place.x < 0 || place.x > width) return null;
  const x = Math.min(Math.max(place.x, half), width - half);
  return { left: x - half + 2, right: x + half, top: place.y - 7, bottom: place.y + 7 };
}

function meet(a, b) {
  return a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
}

/** Numbers in m along the two edges of the floor that are nearest to the camera, or the others. */
function metreLabels(camera, { floor: { x, y } }, colours) {
  const depthOf = (point) => camera.project(point)?.depth ?? Infinity;
  const near = (ends) => (depthOf(ends[0]) < depthOf(ends[1]) ? 0 : 1);
  const front = near([[(x[0] + x[1]) / 2, y[0], 0], [(x[0] + x[1]) / 2, y[1], 0]]);
  const side = near([[x[0], (y[0] + y[1]) / 2, 0], [x[1], (y[0] + y[1]) / 2, 0]]);
  const every = Math.ceil((x[1] - x[0] + y[1] - y[0]) / 16);
  const out = (edge) => (edge ? 0.3 : -0.3);
  const labels = [];
  const add = (words, points) => labels.push({ words, at: points.map(camera.project), colour: colours.faint });
  for (let at = x[1]; at >= x[0]; at -= every) add(at === x[1] ? `x = ${at} m` : `${at}`, [[at, y[front] + out(front), 0]]);
  for (let at = y[1]; at >= y[0]; at -= every) add(at === y[1] ? `y = ${at} m` : `${at}`, [[x[side] + out(side), at, 0]]);
  return labels;
}

const ASIDE = [0, 10, -10, 20, -20, 35, -35, 50, -50].map((degrees) => (degrees * Math.PI) / 180);

/** Range of every ring, ahead of the radar or beside that. */
function ringLabels(camera, scene, colours) {
  return ringRanges(scene).map((range) => {
    const radius = Math.sqrt(range * range - scene.radar[2] ** 2);
    const at = ASIDE.map((by) => {
      const angle = scene.azimuth + by;
      return [scene.radar[0] + radius * Math.cos(angle), scene.radar[1] + radius * Math.sin(angle), 0];
    });
    return { words: `${range} m`, at: at.filter((point) => isOnFloor(point, scene)).map(camera.project), colour: colours.text };
  });
}

function isOnFloor([px, py], { floor: { x, y } }) {
  return px >= x[0] && px <= x[1] && py >= y[0] && py <= y[1];
}

function radarLabel(context, camera, { radar }, colours) {
  const words = `radar, ${radar[2].toFixed(2)} m high`;
  const place = camera.project(radar);
  const aside = context.measureText(words).width / 2 + 12;
  const at = place ? [[aside, -10], [-aside, -10], [0, -20], [aside, 12], [-aside, 12]].map(([x, y]) => ({ x: place.x + x, y: place.y + y })) : [];
  return { words, at, colour: colours.text };
}

/** Ranges of the rings that lie on the floor. */
function ringRanges(scene) {
  const far = Math.max(...scene.corners.map((corner) => Math.hypot(...corner.map((value, n) => value - scene.radar[n]))));
  const every = Math.max(1, Math.ceil(far / 8));
  return Array.from({ length: Math.floor((far + 0.5) / every) }, (_, n) => (n + 1) * every).filter((range) => range > Math.abs(scene.radar[2]));
}

/** Arc on the floor at a slant range from the radar; none below its height. */
function arc({ radar, azimuth }, range) {
  const radius = Math.sqrt(Math.max(range * range - radar[2] * radar[2], 0));
  const points = [];
  for (let angle = -SECTOR; angle <= SECTOR + 1e-9; angle += STEP) {
    points.push([radar[0] + radius * Math.cos(azimuth + angle), radar[1] + radius * Math.sin(azimuth + angle), 0]);
  }
  return points;
}

export function drawRings(context, camera, scene, colours) {
  context.strokeStyle = colours.faint;
  context.lineWidth = 1;
  context.globalAlpha = 0.55;
  for (const range of ringRanges(scene)) onFloor(context, camera, scene, () => strokePath(context, camera, arc(scene, range)));
  context.globalAlpha = 1;
}

/** The gate: what lies on the floor between its two ranges. */
export function drawGate(context, camera, scene, [low, high], colour, selected) {
  const [inner, outer] = [arc(scene, low), arc(scene, high)];
  onFloor(context, camera, scene, () => {
    path(context, camera, [...inner, ...outer.toReversed(), inner[0]]);
    context.fillStyle = colour;
    context.globalAlpha = selected ? 0.16 : 0.08;
    context.fill();
    context.globalAlpha = selected ? 0.95 : 0.5;
    context.strokeStyle = colour;
    context.lineWidth = 1.5;
    for (const points of [inner, outer]) strokePath(context, camera, points);
  });
}

/** The radar on its height, with the direction that its antenna looks. */
export function drawRadar(context, camera, { radar, azimuth, tilt }, colours) {
  const [x, y] = radar;
  context.strokeStyle = colours.text;
  context.lineWidth = 1.5;
  strokePath(context, camera, [[x, y, 0], radar]);
  const up = (tilt * Math.PI) / 180;
  const look = [Math.cos(azimuth) * Math.cos(up), Math.sin(azimuth) * Math.cos(up), Math.sin(up)];
  context.strokeStyle = colours.accent;
  strokePath(context, camera, [radar, radar.map((value, axis) => value + 0.5 * look[axis])]);
  const place = camera.project(radar);
  if (!place) return;
  const half = Math.max(4, 0.07 * place.scale);
  context.fillStyle = colours.accent;
  context.fillRect(place.x - half, place.y - half, 2 * half, 2 * half);
}
