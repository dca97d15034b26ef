// Bodies of the scene: their pose at a time, bones and points in the order of depth, shadows and paths.

import { strokePath } from "./scene_floor.js";

const BONE_M = 0.03;
const POINT_M = 0.028;

/** Points of a body at a time, [[x, y, z] ...] in m, between the frames by straight lines. */
export function bodyAt({ time, positions }, at) {
  const [frames, count] = positions.shape;
  const place = Math.min(Math.max((at - time.first) / time.step, 0), frames - 1);
  const from = Math.floor(place);
  const share = place - from;
  const next = Math.min(from + 1, frames - 1);
  return Array.from({ length: count }, (_, point) => {
    const [a, b] = [3 * (from * count + point), 3 * (next * count + point)];
    return [0, 1, 2].map((axis) => positions[a + axis] + share * (positions[b + axis] - positions[a + axis]));
  });
}

/** Middle of the known points of a pose. */
export function middleOf(points) {
  const known = points.filter((point) => point.every(Number.isFinite));
  return [0, 1, 2].map((axis) => known.reduce((sum, point) => sum + point[axis], 0) / Math.max(known.length, 1));
}

/** Draw all bodies, the farthest bone or point first; gives the points as drawn, for the mouse. */
export function drawBodies(context, camera, bodies, partColours) {
  const colourOf = (group) => partColours[group] ?? partColours.other ?? "#808080";
  const things = [];
  const seen = [];
  for (const [number, body] of bodies.entries()) {
    const places = body.points.map((point) => (point.every(Number.isFinite) ? camera.project(point) : null));
    drawShadow(context, camera, body.points);
    for (const [n, place] of places.entries()) {
      if (!place) continue;
      things.push({ depth: place.depth - 0.01, place, colour: colourOf(body.parts[n]) });
      seen.push({ ...place, body: number, part: body.parts[n], label: body.label, position: body.points[n] });
    }
    for (let bone = 0; bone < body.pairs.length; bone += 2) {
      const [i, j] = [body.pairs[bone], body.pairs[bone + 1]];
      if (!places[i] || !places[j]) continue;
      const group = body.parts[i] === "torso" ? body.parts[j] : body.parts[i]; // a limb's colour reaches to the trunk
      const depth = (places[i].depth + places[j].depth) / 2;
      things.push({ depth, place: places[i], to: places[j], colour: colourOf(group) });
    }
  }
  things.sort((a, b) => b.depth - a.depth);
  for (const thing of things) (thing.to ? drawBone : drawPoint)(context, thing);
  return seen;
}

function drawBone(context, { place, to, colour }) {
  context.lineCap = "round";
  context.strokeStyle = colour;
  context.lineWidth = Math.max(1.5, (BONE_M * (place.scale + to.scale)) / 2);
  context.beginPath();
  context.moveTo(place.x, place.y);
  context.lineTo(to.x, to.y);
  context.stroke();
}

function drawPoint(context, { place, colour }) {
  context.fillStyle = colour;
  context.strokeStyle = "rgba(0, 0, 0, 0.45)";
  context.lineWidth = 0.8;
  context.beginPath();
  context.arc(place.x, place.y, Math.max(2, POINT_M * place.scale), 0, 2 * Math.PI);
  context.fill();
  context.stroke();
}

/** Points on the floor below the body: they show its distance. */
function drawShadow(context, camera, points) {
  context.fillStyle = "rgba(0, 0, 0, 0.22)";
  for (const [x, y] of points) {
    const place = camera.project([x, y, 0]);
    if (!place) continue;
    context.beginPath();
    context.ellipse(place.x, place.y, 0.06 * place.scale, 0.06 * place.scale * Math.abs(Math.sin(camera.pitch)) + 0.5, 0, 0, 7);
    context.fill();
  }
}

/** Path of a body's middle on the floor over the whole recording. */
export function drawPath(context, camera, { positions }, colours) {
  const [frames, count] = positions.shape;
  const every = Math.max(1, Math.floor(frames / 120));
  context.strokeStyle = colours.accent;
  context.globalAlpha = 0.6;
  context.lineWidth = 1.2;
  context.setLineDash([3, 4]);
  const points = [];
  for (let frame = 0; frame < frames; frame += every) points.push([...middle(positions, frame, count), 0]);
  strokePath(context, camera, points);
  context.setLineDash([]);
  context.globalAlpha = 1;
}

function middle(positions, frame, count) {
  let [x, y, known] = [0, 0, 0];
  for (let point = 0; point < count; point += 1) {
    const at = 3 * (frame * count + point);
    if (!Number.isFinite(positions[at])) continue;
    [x, y, known] = [x + positions[at], y + positions[at + 1], known + 1];
  }
  return [x / known, y / known];
}
