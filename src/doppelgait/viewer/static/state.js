// What the reader has chosen, kept in the address of the page: a copied link or a reload shows the same.

const listeners = new Set();
let values = new URLSearchParams(location.search);
let written = 0;
let waiting = null;

export function get(name, fallback = null) {
  return values.get(name) ?? fallback;
}

/** All choices as a list of [name, value]. */
export function entries() {
  return [...values.entries()];
}

/** Number of a choice, or the fallback where it is missing or no number. */
export function getNumber(name, fallback = null) {
  const text = values.get(name);
  const number = text === null || text === "" ? NaN : Number(text);
  return Number.isFinite(number) ? number : fallback;
}

/**
 * Change choices: `{name: value}`, a list for repeated names, null or "" to forget one.
 * `push` makes a step for the browser's back button; `quiet` notifies no listener.
 */
export function set(changes, { push = false, quiet = false } = {}) {
  const names = new Set();
  for (const [name, value] of Object.entries(changes)) {
    const wanted = (Array.isArray(value) ? value : [value]).filter((one) => one !== null && one !== undefined && one !== "");
    if (wanted.map(String).join("\n") === values.getAll(name).join("\n")) continue;
    values.delete(name);
    for (const one of wanted) values.append(name, one);
    names.add(name);
  }
  if (!names.size) return;
  write(push);
  if (!quiet) notify(names);
}

/** Call `listener(names)` with the set of changed names; gives a function that ends it. */
export function subscribe(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

function notify(names) {
  // one listener may end another: the page of the tab that is left must not follow
  for (const listener of [...listeners]) if (listeners.has(listener)) listener(names);
}

function write(push) {
  clearTimeout(waiting);
  const text = values.toString();
  const put = () => {
    written = performance.now();
    history[push ? "pushState" : "replaceState"](null, "", text ? `?${text}` : location.pathname);
  };
  // browsers refuse more than some changes of the address a second
  if (push || performance.now() - written > 300) put();
  else waiting = setTimeout(put, 300);
}

addEventListener("popstate", () => {
  clearTimeout(waiting);
  const before = values;
  values = new URLSearchParams(location.search);
  const names = new Set([...before.keys(), ...values.keys()]);
  notify(new Set([...names].filter((name) => before.getAll(name).join("\n") !== values.getAll(name).join("\n"))));
});
