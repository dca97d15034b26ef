// What to show: target, segment, gate, parameters of the analysis, colour map, levels, part of the Doppler axis.

import * as state from "./state.js";
import { element, field, fillSelect, span } from "./ui.js";

const GATE_WORDS = { track: "tracked", truth: "true range" };
export const STORED = ["result", "example"]; // kinds of runs that show what was stored until a gate is chosen
const OWN = "own";
const CLUTTER = [["median", "remove median"], ["mean", "remove mean"], ["exponential", "remove exponential mean"], ["mti", "remove by MTI"], ["none", "keep"]];
/** Numbers of the analysis: name of the parameter, words, unit, and what it is. */
const NUMBERS = [
  { name: "cpi_s", words: "processing interval", unit: "s", min: 0, step: 0.01, title: "Coherent processing interval T_d" },
  { name: "window_steepness", words: "window σ", unit: "", min: 0, step: 0.05, title: "Steepness of the Gaussian window; a smaller one is narrower in time and wider in Doppler" },
  { name: "hop", words: "hop", unit: "pulses", min: 1, step: 1, title: "Pulses from one column of the signature to the next" },
];
/** Parameters of the analysis that the controls change, as requests have them. */
export const ANALYSIS = ["clutter", ...NUMBERS.map(({ name }) => name)];
const LEVEL_TITLE = "Levels at the ends of the colour scale, in dB relative to the maximum of each picture; empty: automatic";

/** Bar of controls; every choice goes into the state, and who listens to it draws. */
export function makeControls(session) {
  const target = element("select", { id: "target", onchange: () => state.set({ target: Number(target.value) || null }) });
  const low = levelInput("db-low", "lo", "low");
  const high = levelInput("db-high", "hi", "high");
  const auto = element("button", { type: "button", title: "Automatic levels for each picture", onclick: () => state.set({ lo: null, hi: null }) }, "auto");
  const map = makeSelect("map", "map", Object.keys(session.colour_maps).map((name) => [name, name]), session.default_map);
  const band = makeSelect("band", "band", [["occupied", "occupied"], ["all", "whole band"]], "occupied");
  const faults = {}; // lines for errors, by control
  let edited = null; // control that was changed last
  const clutter = element("select", { id: "clutter", onchange: () => edit("clutter", clutter.value) });
  const numbers = NUMBERS.map(makeNumber);
  const gate = makeGate(session, { edit, refuse: (words) => say("gate", words) });
  const segment = element("select", { id: "segment", onchange: () => state.set({ segment: segment.value }) });
  const segments = field("segment", segment, "Segment of steady motion for the cadence-velocity diagram and the features");
  segments.hidden = true;
  const node = element(
    "div",
    { class: "controls", role: "group", "aria-label": "What to show" },
    field("target", target),
    segments,
    withFault("gate", gate.node),
    withFault("clutter", field("static clutter", clutter, "Echoes of static objects, in all pictures, the features and the sound")),
    ...numbers.map((number) => withFault(number.name, number.node)),
    element("button", { id: "standard", type: "button", title: "Gate and analysis settings from the start", onclick: standard }, "reset analysis"),
    field("Doppler", band),
    field("colours", map),
    element("span", { class: "field", title: LEVEL_TITLE }, "levels ", low, " to ", high, " dB ", auto),
  );
  const stop = state.subscribe(restore);
  restore();
  return { node, fillTargets, fillSegments, fillGates: gate.fill, fillAnalysis, fault, clearFaults, destroy: stop };

  /** Place for the error of a control, in one line after it. */
  function withFault(name, control) {
    faults[name] = element("output", { id: `fault-${name}`, class: "fault" });
    return element("span", { class: "with-fault" }, control, faults[name]);
  }

  function edit(name, value) {
    edited = name;
    clearFaults();
    state.set({ [name]: value });
  }

  function standard() {
    edited = null;
    clearFaults();
    state.set(Object.fromEntries(["gate", ...ANALYSIS].map((name) => [name, null])));
  }

  function say(name, words) {
    faults[name].textContent = words;
    faults[name].title = words;
  }

  function clearFaults() {
    for (const name of Object.keys(faults)) say(name, "");
  }

  /** Show an error next to the control that it names, or that was changed last; false where there is none. */
  function fault(words) {
    const named = /^(\w+): /.exec(words)?.[1];
    const name = named in faults ? named : edited;
    if (name) say(name, named === name ? words.slice(name.length + 2) : words);
    return Boolean(name);
  }

  function makeNumber({ name, words, unit, min, step, title }) {
    const input = element("input", { id: name, type: "number", min, step, onchange: () => edit(name, input.value) });
    const node = element("label", { class: "field", title }, `${words} `, input, unit ? ` ${unit}` : null);
    return { name, input, node };
  }

  function fillTargets(targets, selected) {
    const choices = targets.map((one) => [one.number, `${one.number}: ${one.label || "target"} (${one.gate})`]);
    fillSelect(target, choices.length ? choices : [["", "none"]], choices.length ? selected : "");
    target.disabled = choices.length < 2;
  }

  /** Segments of the chosen target; hidden where there is only one. */
  function fillSegments(chosen) {
    const list = chosen?.segments ?? [];
    segments.hidden = list.length < 2 || !Number.isInteger(chosen.segment);
    if (segments.hidden) return;
    const name = (number) => `${chosen.number}:${number}`;
    const choices = list.map((ends, number) => [name(number), `${number + 1} of ${list.length}: ${span(ends)}`]);
    fillSelect(segment, choices, name(chosen.segment));
  }

  /** Parameters in use; results are as they were stored, and there is nothing to choose. */
  function fillAnalysis({ kind, duration_s: duration, analysis }) {
    const stored = duration === null || (STORED.includes(kind) && !state.get("gate"));
    clutter.disabled = stored;
    fillSelect(clutter, stored ? [["", "as stored"]] : CLUTTER, stored ? "" : analysis.clutter);
    for (const { name, input, node } of numbers) {
      node.parentNode.hidden = kind === "try" && name === "cpi_s"; // has its own slider there
      input.disabled = stored;
      input.value = stored ? "" : state.get(name) ?? shortest(analysis[name]);
    }
  }

  function restore() {
    for (const select of [map, band]) select.restore();
    for (const input of [low, high]) input.value = state.get(input.name, "");
    gate.restore();
  }
}

/** A number without the digits that only its binary form has. */
function shortest(value) {
  return value === null || value === undefined ? "" : String(Number(value.toPrecision(6)));
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
function makeGate(session, { edit, refuse }) {
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
    if (select.value !== OWN) edit("gate", select.value);
    else if (ends.every((end) => end.value)) apply();
    else ends[0].focus();
  }

  function apply() {
    const [low, high] = ends.map((end) => end.valueAsNumber);
    if (!Number.isFinite(low) || !Number.isFinite(high)) return;
    if (low < high) edit("gate", `${low}:${high}`);
    else refuse("the gate ends before it begins; the second range must be larger");
  }
}
