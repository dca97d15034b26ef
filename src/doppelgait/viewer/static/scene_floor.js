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
  drawMetres(context, camera, scene.floor, colours);
}

function strokePath(context, camera, points) {
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

/** Numbers in m along the two edges of the floor that are nearest to the camera. */
function drawMetres(context, camera, { x, y }, colours) {
  context.fillStyle = colours.faint;
  context.textAlign = "center";
  context.textBaseline = "middle";
  const near = (ends) => (depthOf(ends[0]) < depthOf(ends[1]) ? 0 : 1);
  const depthOf = (point) => camera.project(point)?.depth ?? Infinity;
  const front = near([[(x[0] + x[1]) / 2, y[0], 0], [(x[0] + x[1]) / 2, y[1], 0]]);
  const side = near([[x[0], (y[0] + y[1]) / 2, 0], [x[1], (y[0] + y[1]) / 2, 0]]);
  const every = Math.ceil((x[1] - x[0] + y[1] - y[0]) / 16);
  const out = (edge) => (edge ? 0.3 : -0.3);
  for (let at = x[1]; at >= x[0]; at -= every) text(context, camera, [at, y[front] + out(front), 0], at === x[1] ? `x = ${at} m` : `${at}`);
  for (let at = y[1]; at >= y[0]; at -= every) text(context, camera, [x[side] + out(side), at, 0], at === y[1] ? `y = ${at} m` : `${at}`);
}

function text(context, camera, point, words) {
  const place = camera.project(point);
  if (!place) return;
  const [half, width] = [context.measureText(words).width / 2 + 2, context.canvas.clientWidth];
  const inside = place.x > 0 && place.x < width; // then all of the text is to be
  context.fillText(words, inside ? Math.min(Math.max(place.x, half), width - half) : place.x, place.y);
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
  const far = Math.max(...scene.corners.map((corner) => Math.hypot(...corner.map((value, n) => value - scene.radar[n]))));
  const every = Math.max(1, Math.ceil(far / 8));
  context.strokeStyle = colours.faint;
  context.fillStyle = colours.text;
  context.lineWidth = 1;
  for (let range = every; range <= far + 0.5; range += every) {
    if (range <= Math.abs(scene.radar[2])) continue;
    context.globalAlpha = 0.55;
    onFloor(context, camera, scene, () => strokePath(context, camera, arc(scene, range)));
    context.globalAlpha = 1;
    const radius = Math.sqrt(range * range - scene.radar[2] ** 2);
    const ahead = [scene.radar[0] + radius * Math.cos(scene.azimuth), scene.radar[1] + radius * Math.sin(scene.azimuth), 0];
    text(context, camera, ahead, `${range} m`);
  }
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
  const [x, y, z] = radar;
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
  context.fillStyle = colours.text;
  context.textAlign = "left";
  context.textBaseline = "bottom";
  context.fillText(`radar, ${z.toFixed(2)} m high`, place.x + half + 4, place.y - 2);
}
