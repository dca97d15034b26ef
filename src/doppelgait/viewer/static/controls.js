// What to show: target, gate, colour map, range of levels, part of the Doppler axis, static clutter.

import * as state from "./state.js";
import { element, field, fillSelect, span, words } from "./ui.js";

const GATE_WORDS = { track: "tracked", truth: "true range" };
const STORED = ["result", "example"]; // kinds of runs that show what was stored until a gate is chosen
const OWN = "own";
const LEVEL_TITLE = "Levels at the ends of the colours, in dB relative to the strongest of each picture; empty: chosen by the picture";

/** Bar of controls; every choice goes into the state, and who listens to it draws. */
export function makeControls(session) {
  const target = element("select", { id: "target", onchange: () => state.set({ target: Number(target.value) || null }) });
  const low = levelInput("db-low", "lo", "low");
  const high = levelInput("db-high", "hi", "high");
  const auto = element("button", { type: "button", title: "Levels as each picture chooses them", onclick: () => state.set({ lo: null, hi: null }) }, "auto");
  const map = makeSelect("map", "map", Object.keys(session.colour_maps).map((name) => [name, name]), session.default_map);
  const band = makeSelect("band", "band", [["occupied", "occupied"], ["all", "whole band"]], "occupied");
  const clutter = element("select", { id: "clutter", onchange: () => state.set({ clutter: clutter.value }) });
  const piece = element("select", { id: "piece", onchange: () => state.set({ piece: piece.value }) });
  const pieces = field("piece", piece, "Stretch of steady motion that the signature, the map and the features come from");
  pieces.hidden = true;
  const gate = makeGate(session);
  const node = element(
    "div",
    { class: "controls", role: "group", "aria-label": "What to show" },
    field("target", target),
    pieces,
    gate.node,
    field("static clutter", clutter, "What stands still: in all pictures, the features and the sound"),
    field("Doppler", band),
    field("colours", map),
    element("span", { class: "field", title: LEVEL_TITLE }, "levels ", low, " to ", high, " dB ", auto),
  );
  const stop = state.subscribe(restore);
  restore();
  return { node, fillTargets, fillPieces, fillGates: gate.fill, fillClutter, destroy: stop };

  function fillTargets(targets, selected) {
    const choices = targets.map((one) => [one.number, `${one.number + 1} of ${targets.length}: ${one.label || "target"} (${one.gate})`]);
    fillSelect(target, choices.length ? choices : [["", "none"]], choices.length ? selected : "");
    target.disabled = choices.length < 2;
  }

  /** Pieces of the chosen target; nothing to choose where there is one. */
  function fillPieces(chosen) {
    const list = chosen?.pieces ?? [];
    pieces.hidden = list.length < 2 || !Number.isInteger(chosen.piece);
    if (pieces.hidden) return;
    const name = (number) => `${chosen.number}:${number}`;
    const choices = list.map((ends, number) => [name(number), `${number + 1} of ${list.length}: ${span(ends)}`]);
    fillSelect(piece, choices, name(chosen.piece));
  }

  /** How clutter was treated; results are as they were stored, and there is nothing to choose. */
  function fillClutter({ kind, duration_s: duration, clutter: done }) {
    const stored = duration === null || (STORED.includes(kind) && !state.get("gate"));
    clutter.disabled = stored;
    if (stored) return fillSelect(clutter, [["", "as stored"]], "");
    const removed = done && done !== "none" ? `removed (${words(done)})` : "removed";
    fillSelect(clutter, [["removed", removed], ["kept", "kept"]], done === "none" ? "kept" : "removed");
  }

  function restore() {
    for (const select of [map, band]) select.restore();
    for (const input of [low, high]) input.value = state.get(input.name, "");
    gate.restore();
  }
}

function makeSelect(id, name, choices, standard) {
  const select = element("select", { id, onchange: () => state.set({ [name]: select.value === standard ? null : select.value }) });
  fillSelect(select, choices, standard);
  select.restore = () => {
    const chosen = state.get(name, standard);
    select.value = choices.some(([value]) => value === chosen) ? chosen : standard;
  };
  return select;
}

function levelInput(id, name, words) {
  const set = () => input.reportValidity() && state.set({ [name]: input.value });
  const input = element("input", {
    id, name, type: "number", min: -150, max: 20, step: 1, placeholder: "auto", "aria-label": `${words} level in dB`, onchange: set,
  });
  return input;
}

/** Choice of the gate: what the run shows first, those that it allows, or two ranges of one's own. */
function makeGate(session) {
  let choices = [["", "…"]];
  const select = element("select", { id: "gate", onchange: choose });
  const ends = ["from", "to"].map((side) =>
    element("input", { id: `gate-${side}`, type: "number", min: 0, step: 0.05, "aria-label": `Gate ${side}, m`, onchange: apply }),
  );
  const own = element("span", { class: "own-gate", hidden: true }, ends[0], " – ", ends[1], " m");
  const node = element("span", { class: "field" }, element("label", { for: "gate" }, "gate "), select, own);
  return { node, restore, fill };

  /** Gates of a recording: those of a stored result can only be chosen where its recording is there. */
  function fill({ kind, truth, duration_s: duration }) {
    const first = STORED.includes(kind) ? "as stored" : kind === "try" ? "truth" : session.default_gate;
    const others = ["track", ...(truth?.length ? ["truth"] : [])].filter((gate) => gate !== first);
    const named = [first, ...others].map((gate, n) => [n ? gate : "", GATE_WORDS[gate] ?? gate]);
    choices = duration === null ? named.slice(0, 1) : [...named, [OWN, "fixed"]];
    restore();
  }

  function restore() {
    const chosen = state.get("gate", "");
    const limits = /^([\d.]+):([\d.]+)$/.exec(chosen);
    fillSelect(select, choices, limits ? OWN : chosen);
    if (select.selectedIndex < 0) select.selectedIndex = 0;
    own.hidden = !limits;
    if (limits) ends.forEach((end, n) => (end.value = limits[n + 1]));
  }

  function choose() {
    own.hidden = select.value !== OWN;
    if (select.value !== OWN) state.set({ gate: select.value });
    else if (ends.every((end) => end.value)) apply();
    else ends[0].focus();
  }

  function apply() {
    const [low, high] = ends.map((end) => end.valueAsNumber);
    if (!Number.isFinite(low) || !Number.isFinite(high)) return;
    ends[1].setCustomValidity(low < high ? "" : "The gate ends before it begins: the second range must be larger.");
    if (ends[1].reportValidity()) state.set({ gate: `${low}:${high}` });
  }
}
