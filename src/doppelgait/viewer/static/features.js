// Table of a target's features with deviation, unit and truth; its flags in words; quality and further features.

import { element, fixed, flagWords, makePanel, shownSegment, significant, span, words } from "./ui.js";

/** Relative deviation from the truth above which a value is highlighted. */
const FAR = 0.2;
/** Rows before a feature of the set: name, words, unit, and where a target has it. */
const BEFORE = { step_length_m: ["ground_step_length_m", "ground step length", "m", "quality"] };
const AFTER = [["breathing_rate_hz", "breathing rate", "Hz", "quality"]];
const OWN_WORDS = { step_length_m: "radial step length" };
/** Smallest true value with a deviation in per cent, by unit: below it a share says nothing. */
const LEAST = { "m/s": 0.1, Hz: 0.2, m: 0.05, 1: 0.02 };
const UNITS = { mps: "m/s", hz: "Hz", m: "m", s: "s", db: "dB", deg: "°", m2: "m²", kg: "kg" };

/** Words and unit of a column from its name: "ground speed", "m/s". */
export function quantity(name) {
  const [, stem, suffix] = /^(.*)_([a-z0-9]+)$/.exec(name) ?? [];
  return stem && suffix in UNITS ? [words(stem), UNITS[suffix]] : [words(name), ""];
}

export function makeFeatures({ session, before: own }, { id = "features", before = own } = {}) {
  const panel = makePanel(id, `${before}Features`, "features");
  panel.body.className = "feature-body";
  return { node: panel.node, show, say: panel.say };

  function show(target) {
    const title = target ? `Features of ${target.label || "the target"}` : "Features";
    panel.heading.textContent = before + [title, span(shownSegment(target))].filter(Boolean).join(", ");
    panel.body.replaceChildren(...(target ? contents(target) : []).filter(Boolean));
  }

  function contents(target) {
    const truth = target.truth ?? {};
    const found = featuresOf(target, session);
    const rows = found.map((one) => featureRow(one));
    const known = new Set(found.map(({ key }) => key));
    return [
      element(
        "table",
        { id: id === "features" ? id : null, class: "features" },
        element("thead", {}, row("th", ["feature", "value", "± sd", "unit", "truth"])),
        element("tbody", {}, rows),
      ),
      flagList(target.flags ?? []),
      details("Truth of this target", Object.entries(truth).filter(([key]) => !known.has(key))),
      details("Quality", Object.entries(target.quality ?? {})),
      details("Further features", Object.entries(target.extended ?? {}), target.standard_deviation),
    ];
  }

  function featureRow({ key, name, value, deviation, unit, truth }) {
    const cells = [name, significant(value), significant(deviation, 2), unit === "1" ? "" : unit];
    const node = row("td", [...cells, compared(truth, { value, deviation, unit })]);
    if (value === null || value === undefined) node.title = "not determined; see the flags below";
    if (key === "breathing_rate_hz") node.title = `${significant(60 * value)} breaths a minute`;
    if (isFar(truth, { value, unit })) {
      node.className = "far";
      node.title = `more than ${100 * FAR} % from the truth`;
    }
    return node;
  }
}

/** Features of a target as the table shows them: the set, the ground step length first, and the breathing rate. */
export function featuresOf(target, session) {
  const truth = target.truth ?? {};
  const of = ([key, name, unit, group]) => {
    const value = target[group]?.[key];
    const there = typeof value === "number";
    return there ? [{ key, name, unit, value, deviation: target.standard_deviation?.[key], truth: truth[key] }] : [];
  };
  const set = session.feature_names.flatMap(([key, name, unit]) => {
    const own = { key, name: OWN_WORDS[key] ?? words(name), unit, value: target.features[key], truth: truth[key] };
    return [...(key in BEFORE ? of(BEFORE[key]) : []), { ...own, deviation: deviationOf(target, key) }];
  });
  return [...set, ...AFTER.flatMap(of)];
}

/** Whether a measured value is so far from the true one that it must be seen at once. */
export function isFar(truth, { value, unit }) {
  if (typeof truth !== "number" || !Number.isFinite(value)) return false;
  return Math.abs(value - truth) > Math.max(FAR * Math.abs(truth), LEAST[unit] ?? 0);
}

/** Standard deviation of a feature; the torso's Doppler has that of its velocity, in Hz. */
function deviationOf({ features, standard_deviation: known }, key) {
  if (key !== "torso_doppler_hz" || Number.isFinite(known?.[key])) return known?.[key];
  const deviation = (known?.torso_velocity_mps ?? NaN) * Math.abs(features.torso_doppler_hz / features.torso_velocity_mps);
  return Number.isFinite(deviation) ? deviation : null;
}

/** The true value and, in per cent of it, how far off the found one is; no share of what is next to zero. */
export function compared(truth, { value, deviation = null, unit = "" }) {
  if (truth === null || truth === undefined) return "–";
  if (typeof truth !== "number") return words(truth);
  const least = Math.max(LEAST[unit] ?? 1e-6, deviation ?? 0);
  if (!Number.isFinite(value) || Math.abs(truth) < least) return significant(truth);
  const off = Math.round((100 * (value - truth)) / Math.abs(truth));
  return `${significant(truth)} (${off > 0 ? "+" : ""}${fixed(off, 0)} %)`;
}

function flagList(flags) {
  if (!flags.length) return element("p", { class: "flags none" }, "No flags.");
  return element("ul", { class: "flags", "aria-label": "Flags" }, flags.map((flag) => element("li", {}, flagWords(flag))));
}

function details(title, pairs, deviations = {}) {
  if (!pairs.length) return null;
  const rows = pairs.map(([key, value]) => {
    const [name, unit] = quantity(key);
    const sd = deviations?.[key];
    return row("td", [name, textOf(value) + (Number.isFinite(sd) ? ` ± ${significant(sd, 2)}` : ""), unit]);
  });
  return element("details", {}, element("summary", {}, title), element("table", {}, element("tbody", {}, rows)));
}

function textOf(value) {
  if (typeof value === "number") return significant(value, 4);
  if (value === null || value === undefined) return "–";
  if (typeof value === "object") return JSON.stringify(value);
  return words(value === true ? "yes" : value === false ? "no" : value);
}

function row(tag, cells) {
  return element("tr", {}, cells.map((cell, n) => element(n === 0 ? "th" : tag, {}, cell)));
}
