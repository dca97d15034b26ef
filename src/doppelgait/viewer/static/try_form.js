// The controls of "Try it": sliders with numbers, choices, and examples to begin with.

import { element, fillSelect } from "./ui.js";

const EXAMPLES = [
  ["person walking in", { who: "person" }],
  ["person running past", { who: "person", speed_mps: 3, aspect_deg: 60, range_m: 6, radar: "x4" }],
  ["dog trotting across", { who: "dog", speed_mps: 2, gait: "trot", aspect_deg: 75 }],
  ["dog galloping in", { who: "dog", speed_mps: 4, gait: "gallop", range_m: 6, duration_s: 2 }],
  ["person and dog side by side", { who: "person", company: "dog" }],
  ["fan", { who: "fan", rotation_hz: 3 }],
];

/**
 * Form of the controls that the server has named; `changed()` is called at every move of a slider.
 *
 * Values that are not the defaults are kept in the address of the page.
 */
export function makeTryForm(controls, state, changed) {
  const rows = controls.map((control) => makeRow(control, edited));
  const [who] = rows;
  const buttons = EXAMPLES.map(([words, example]) => element("button", { type: "button", onclick: () => take(example) }, words));
  const node = element(
    "form",
    { id: "try-form", class: "panel try-form", "aria-label": "What to simulate", onsubmit: () => false },
    element("div", { class: "try-examples", role: "group", "aria-label": "Examples" }, buttons),
    element("div", { class: "try-rows" }, rows.map((row) => row.node)),
  );
  read();
  return { node, values, restore };

  /** Values that differ from the target's defaults, by name. */
  function values() {
    const found = rows.filter((row) => row.fits(who.value())).map((row) => [row.name, row.value(), row.standard(who.value())]);
    return Object.fromEntries(found.filter(([, value, standard]) => value !== String(standard)).map(([name, value]) => [name, value]));
  }

  function edited(row) {
    if (row === who) rows.slice(1).forEach((one) => one.adapt(who.value(), null));
    bound(row);
    keep();
    changed();
  }

  /** Limits of each control as the others stand; another than the one in hand also moves into them. */
  function bound(inHand, moves = true) {
    const current = Object.fromEntries(rows.filter((row) => row.fits(who.value())).map((row) => [row.name, row.value()]));
    for (const row of rows) row.bound(current, moves && row !== inHand);
  }

  function keep() {
    const now = values();
    state.set(Object.fromEntries(rows.map(({ name }) => [name, now[name] ?? null])), { quiet: true });
  }

  function take(example) {
    put((name) => example[name]);
    bound(null);
    keep();
    changed();
  }

  function read() {
    put((name) => state.get(name));
    bound(null, false); // what a link asks for is refused rather than changed
  }

  function put(get) {
    who.adapt(null, get("who"));
    for (const row of rows.slice(1)) row.adapt(who.value(), get(row.name));
  }

  /** The address has changed: back and forward. */
  function restore(names) {
    if (!rows.some((row) => names.has(row.name))) return;
    read();
    changed();
  }
}

/** One control: `value()` as text, `adapt(who, value)` to a target, with its default where there is no value. */
function makeRow(control, edited) {
  const id = `try-${control.name}`;
  const input = control.kind === "choice" ? makeChoice(control, id) : makeNumbers(control, id);
  const label = element("label", { for: id }, control.words);
  const node = element("div", { class: "try-row", title: control.help }, label, ...input.nodes);
  const row = { name: control.name, node, value: input.value, fits, standard, adapt, bound };
  node.addEventListener("input", (event) => {
    input.follow(event.target);
    edited(row);
  });
  return row;

  function fits(who) {
    return control.who.includes(who);
  }

  function standard(who) {
    return control.by_who[who]?.default ?? control.default;
  }

  function adapt(who, value) {
    node.hidden = who !== null && !fits(who);
    input.limit(who, control.by_who[who] ?? {});
    input.put(value ?? standard(who));
  }

  function bound(current, moves) {
    if (!control.limits.length) return;
    const [low, high] = limitsOf(control, current);
    input.limit(null, { low, high });
    if (moves) input.put(Math.min(Math.max(Number(input.value()), low), high));
  }
}

/** Limits of a control while the others have these values, inwards to whole steps. */
function limitsOf(control, current) {
  const own = control.by_who[current.who] ?? {};
  let low = own.low ?? control.low;
  let high = own.high ?? control.high;
  for (const limit of control.limits) {
    if (!Object.entries(limit.when).every(([name, value]) => current[name] === value)) continue;
    const scale = limit.size ? Number(current[limit.size]) ** limit.power : 1;
    low = Math.max(low, limit.low === null ? low : inwards(limit.low * scale, control.step, Math.ceil));
    high = Math.min(high, limit.high === null ? high : inwards(limit.high * scale, control.step, Math.floor));
  }
  return [low, Math.max(low, high)];
}

function inwards(value, step, round) {
  const steps = value / step;
  const whole = Math.abs(steps - Math.round(steps)) < 1e-6 ? Math.round(steps) : round(steps);
  return Number((whole * step).toFixed(6));
}

function makeChoice(control, id) {
  const select = element("select", { id });
  return { nodes: [select], value: () => select.value, follow: () => {}, limit, put };

  function limit(who) {
    const allowed = control.values_by_who[who];
    fillSelect(select, control.values.filter(([value]) => !allowed || allowed.includes(value)), control.default);
  }

  function put(value) {
    const there = [...select.options].some((option) => option.value === String(value));
    select.value = there ? value : control.default;
  }
}

/** A slider, and the number itself beside it; while the number is empty the last one holds. */
function makeNumbers(control, id) {
  const limits = { min: control.low, max: control.high, step: control.step };
  const slider = element("input", { id, type: "range", ...limits });
  const number = element("input", { id: `${id}-number`, type: "number", ...limits, "aria-label": control.words });
  const unit = element("span", { class: "unit" }, control.unit);
  let last = String(control.default);
  number.addEventListener("change", () => { if (number.value === "") put(last); });
  return { nodes: [slider, number, unit], value: () => last, follow, limit, put };

  function follow(moved) {
    if (moved === slider) number.value = slider.value;
    else if (number.value !== "") slider.value = number.value;
    last = number.value || last;
  }

  function limit(who, own) {
    for (const input of [slider, number]) Object.assign(input, { min: own.low ?? control.low, max: own.high ?? control.high });
  }

  function put(value) {
    last = String(value);
    slider.value = value;
    number.value = value;
  }
}
