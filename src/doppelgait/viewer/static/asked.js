// What the address asks of the dataset browser: filters, order, page. What this dataset does not know is taken out.

import * as state from "./state.js";

const FILTER = "f."; // in the page's address filters stand apart from the other choices
const NUMBER = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i;

export function isFilter(name) {
  return name.startsWith(FILTER);
}

/** Filters in force, [name, value], as the server takes them. */
export function filters() {
  return state.entries().filter(([name]) => isFilter(name)).map(([name, value]) => [name.slice(FILTER.length), value]);
}

/** Take these filters and no others, and start at the first page: a step back, but only one for an id that is typed. */
export function setFilters(pairs) {
  const others = (list) => list.filter(([name]) => name !== "text").map(String).join("\n");
  const typing = others(filters()) === others(pairs) && filters().some(([name]) => name === "text");
  state.set({ ...changesTo(pairs), offset: null }, { push: !typing });
}

/** The filters as parameters of a request; a column may have any name, also one that every object has. */
export function query() {
  return grouped(filters());
}

/** The filters and the order of the rows as parameters of a request. */
export function listed() {
  return { ...query(), sort: state.get("sort"), descending: state.get("descending") ? 1 : null };
}

/** Take out of the address what this dataset cannot answer; gives these parts as texts. */
export function takeOutUnknown(facts) {
  const columns = new Map(facts.columns.map((column) => [column.name, column]));
  const pairs = filters();
  const kept = pairs.filter((pair, n) => isKnown(pair, columns) && !isSecond(pair, pairs.slice(0, n)));
  const crossed = crossedLimits(kept);
  const wanted = kept.filter(([name]) => !crossed.has(bare(name)));
  const out = pairs.filter((pair) => !wanted.includes(pair)).map((pair) => pair.join("="));
  if (out.length) state.set(changesTo(wanted), { quiet: true });
  const sort = state.get("sort");
  if (sort && !columns.has(sort)) {
    out.push(`sort=${sort}`);
    state.set({ sort: null, descending: null }, { quiet: true });
  }
  return out;
}

/** Changes of the state that leave just these filters. */
function changesTo(pairs) {
  const none = filters().map(([name]) => [FILTER + name, null]);
  return { ...Object.fromEntries(none), ...grouped(pairs, FILTER) };
}

function grouped(pairs, prefix = "") {
  const params = Object.create(null);
  for (const [name, value] of pairs) (params[prefix + name] ??= []).push(value);
  return params;
}

function bare(name) {
  return name.replace(/\.(min|max)$/, "");
}

function isLimit(name) {
  return bare(name) !== name;
}

function isKnown([name, value], columns) {
  if (["text", "flag", "no_flag"].includes(name)) return true;
  const column = columns.get(bare(name));
  if (isLimit(name)) return column?.kind === "number" && NUMBER.test(value) && Number.isFinite(Number(value));
  return column?.kind === "category" && column.values.includes(value);
}

/** Whether a condition that may stand once is there already. */
function isSecond([name], earlier) {
  return (name === "text" || isLimit(name)) && earlier.some(([other]) => other === name);
}

/** Columns with a lower limit above their upper one. */
function crossedLimits(pairs) {
  const limits = new Map(pairs.filter(([name]) => isLimit(name)).map(([name, value]) => [name, Number(value)]));
  const names = [...limits.keys()].map(bare);
  return new Set(names.filter((name) => limits.get(`${name}.min`) > limits.get(`${name}.max`)));
}
