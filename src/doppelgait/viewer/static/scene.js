// The scene in three dimensions on a 2-D canvas: bodies, floor, radar, range rings and the gate.

import { FONT } from "./axes.js";
import { makeLayers, themeColours } from "./canvas.js";
import { gateAt, gateColour } from "./range_time.js";
import { bodyAt, drawBodies, drawPath, middleOf } from "./scene_body.js";
import { drawFloor, drawGate, drawLabels, drawRadar, drawRings, floorOf } from "./scene_floor.js";
import { element, fixed, makePanel } from "./ui.js";
import { makeCamera } from "./view3d.js";

const HIT = 14; // pixels around the mouse in which a point is read
const CLOSE_M = 5;
/** Views by name: degrees beside the antenna's direction and pitch (rad) that the camera looks from. */
const VIEWS = {
  all: { title: "everything in view", degrees: -40, pitch: 0.3 },
  body: { title: "close up, following the body", degrees: -65, pitch: 0.12 },
  side: { title: "from the side", degrees: -90, pitch: 0.06 },
  top: { title: "from above", degrees: -90, pitch: Math.PI / 2 },
  radar: { title: "from the radar", degrees: 180, pitch: 0.12 },
};

export function makeScene({ session, clock, before }) {
  const panel = makePanel("scene", `${before}Scene`);
  const camera = makeCamera();
  let scene = null; // {radar, azimuth, tilt, bodies, arrays, reach, floor}
  let targets = null;
  let seen = []; // projected points of the last drawing, for the mouse
  let mouse = null;
  let view = VIEWS.all; // null once the reader has turned or zoomed
  let following = false; // the camera goes along with the chosen body
  let fitted = ""; // size of the picture that the view was made for
  const layers = makeLayers(panel.body, "scene", { label: "Bodies and radar; drag to turn, wheel to zoom", draw, drawOverlay });
  const canvas = layers.overlay;
  canvas.tabIndex = 0;
  canvas.setAttribute("aria-hidden", "false");
  canvas.setAttribute("aria-label", "Turn with shift and the arrow keys, zoom with + and − while this picture has the focus");
  addViews();
  addPointers(canvas, camera, { moved, hovered });
  return { node: panel.node, show, showTargets, redraw: layers.redraw, tick: layers.redraw, destroy: layers.destroy };

  function addViews() {
    for (const [name, chosen] of Object.entries(VIEWS)) {
      const attributes = { type: "button", class: "small", title: chosen.title, "data-view": name, onclick: () => choose(chosen) };
      panel.tools.append(element("button", attributes, name));
    }
  }

  function show({ facts, arrays }) {
    const pose = facts.scene;
    if (!pose || !facts.bodies?.length) {
      scene = null;
      panel.say(facts.reason || "No scene: the position of the body is known only for simulated recordings.");
      return;
    }
    panel.say(null);
    const bodies = facts.bodies.map((body) => ({ ...body, positions: arrays[body.points], pairs: arrays[body.bones] }));
    scene = { radar: pose.radar_position_m, azimuth: (pose.azimuth_deg * Math.PI) / 180, tilt: pose.tilt_deg, bodies };
    scene.corners = bodies.flatMap(extremes).concat([scene.radar, [scene.radar[0], scene.radar[1], 0]]);
    scene.floor = floorOf(scene);
    const { x, y } = scene.floor;
    scene.corners.push(...x.flatMap((at) => y.map((other) => [at, other, 0])));
    fitted = "";
    layers.redraw();
  }

  function showTargets(next) {
    targets = next;
    layers.redraw();
  }

  function choose(chosen) {
    view = chosen;
    following = chosen === VIEWS.body;
    fitted = "";
    layers.redraw();
  }

  /** Place the camera for the chosen view; again where the picture has another size. */
  function place({ degrees, pitch }) {
    camera.yaw = scene.azimuth + (degrees * Math.PI) / 180;
    camera.pitch = pitch;
    if (following) camera.distance = CLOSE_M;
    else camera.fit(scene.corners);
  }

  function moved() {
    view = null;
    layers.redraw();
  }

  function hovered(at) {
    mouse = at;
    readOut();
    layers.redrawOverlay();
  }

  function draw(context, { width, height }) {
    if (!scene) return;
    camera.setSize(width, height);
    if (view && fitted !== `${width} ${height}`) {
      fitted = `${width} ${height}`;
      place(view);
    }
    const poses = scene.bodies.map((body) => ({ ...body, points: bodyAt(body, clock.time) }));
    if (following) camera.centre = middleOf((poses[targets?.selected] ?? poses[0]).points);
    const colours = themeColours();
    context.font = FONT;
    drawFloor(context, camera, scene, colours);
    drawRings(context, camera, scene, colours);
    for (const [number, target] of (targets?.targets ?? []).entries()) {
      const gate = gateAt(target, targets.arrays, clock.time);
      if (gate) drawGate(context, camera, scene, gate, gateColour(number), number === targets.selected);
    }
    for (const body of scene.bodies) drawPath(context, camera, body, colours);
    drawRadar(context, camera, scene, colours);
    seen = drawBodies(context, camera, poses, session.part_colours);
    drawLabels(context, camera, scene, { places: seen, colours });
    readOut();
  }

  function nearest() {
    let best = null;
    for (const point of mouse ? seen : []) {
      const away = Math.hypot(point.x - mouse.x, point.y - mouse.y);
      if (away < HIT && (!best || away < best.away)) best = { ...point, away };
    }
    return best;
  }

  function readOut() {
    const point = nearest();
    panel.hover.textContent = point ? describe(point) : "";
  }

  function describe({ part, label, position }) {
    const range = Math.hypot(...position.map((value, axis) => value - scene.radar[axis]));
    const place = position.map((value) => fixed(value, 2)).join(", ");
    return `${label}: ${part} at (${place}) m · range ${fixed(range, 3)} m`;
  }

  function drawOverlay(context) {
    const point = nearest();
    if (!point) return;
    context.strokeStyle = themeColours().text;
    context.lineWidth = 1.5;
    context.beginPath();
    context.arc(point.x, point.y, 7, 0, 2 * Math.PI);
    context.stroke();
  }
}

/** Corners of the box that a body moves in. */
function extremes({ positions }) {
  const low = [Infinity, Infinity, 0];
  const high = [-Infinity, -Infinity, 0];
  for (let n = 0; n < positions.length; n += 3) {
    for (let axis = 0; axis < 3; axis += 1) {
      const value = positions[n + axis];
      if (!Number.isFinite(value)) continue;
      low[axis] = Math.min(low[axis], value);
      high[axis] = Math.max(high[axis], value);
    }
  }
  const ends = [low, high];
  return [0, 1, 2, 3, 4, 5, 6, 7].map((n) => [ends[n & 1][0], ends[(n >> 1) & 1][1], ends[n >> 2][2]]);
}

/** Drag turns, wheel and pinch zoom, keys do both. */
function addPointers(canvas, camera, { moved, hovered }) {
  const held = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, event);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => held.delete(event.pointerId));
  }
  canvas.addEventListener("pointerleave", () => hovered(null));
  canvas.addEventListener("pointermove", (event) => {
    if (held.has(event.pointerId)) turn(event);
    const { left, top } = canvas.getBoundingClientRect();
    hovered({ x: event.clientX - left, y: event.clientY - top });
  });
  canvas.addEventListener("wheel", zoomed, { passive: false });
  canvas.addEventListener("keydown", pressed);

  function turn(event) {
    const before = held.get(event.pointerId);
    if (held.size === 1) camera.orbit(event.clientX - before.clientX, event.clientY - before.clientY);
    else camera.zoom(spread() / spread(event));
    held.set(event.pointerId, event);
    moved();
  }

  /** Distance of the first two fingers, one of them moved. */
  function spread(moving = null) {
    const [a, b] = [...held.values()].map((one) => (one.pointerId === moving?.pointerId ? moving : one));
    return Math.max(Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY), 1);
  }

  function zoomed(event) {
    event.preventDefault();
    camera.zoom(Math.exp(0.0015 * Math.min(Math.max(event.deltaY, -300), 300)));
    moved();
  }

  function pressed(event) {
    const turns = { ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, -20], ArrowDown: [0, 20] };
    if (event.shiftKey && event.key in turns) camera.orbit(...turns[event.key]);
    else if (event.key === "+" || event.key === "-") camera.zoom(event.key === "+" ? 0.9 : 1.1);
    else return;
    event.preventDefault();
    event.stopPropagation(); // these keys mean something else on the rest of the page
    moved();
  }
}
