// Small pieces of the page. Text from data always goes in as text, never as HTML.

/** `element("p", {class: "x", onclick: f}, "text", child)`. */
export function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (typeof value === "function") node[name] = value;
    else node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}

/** A labelled control: the words stand before it. */
export function field(words, control, title = null) {
  return element("label", { class: "field", title }, `${words} `, control);
}

/** Fill a select with [value, words] pairs and choose one. */
export function fillSelect(select, choices, chosen) {
  select.replaceChildren(...choices.map(([value, words]) => element("option", { value }, words)));
  select.value = String(chosen);
}

/** Panel with a title, a read-out for the mouse (`hover-NAME`), a place for a colour bar, and a body. */
export function makePanel(name, title) {
  const heading = element("h2", {}, title);
  const hover = element("output", { id: `hover-${name}`, class: "hover", "aria-live": "off" });
  const tools = element("div", { class: "tools" });
  const body = element("div", { class: "plot" });
  const note = element("p", { class: "empty", hidden: true });
  const node = element(
    "section",
    { class: `panel panel-${name}`, "aria-label": title },
    element("header", {}, heading, hover, tools),
    body,
    note,
  );
  return { node, body, hover, tools, heading, say };

  /** Show a sentence in place of the picture; null shows the picture again. */
  function say(words) {
    note.textContent = words ?? "";
    note.hidden = !words;
    body.classList.toggle("hidden", Boolean(words));
  }
}

export function showError(error) {
  const banner = document.getElementById("error");
  const close = element("button", { type: "button", "aria-label": "Close", onclick: () => clearError() }, "×");
  banner.replaceChildren(element("span", {}, error?.message ?? String(error)), close);
  banner.hidden = false;
}

export function clearError() {
  const banner = document.getElementById("error");
  banner.hidden = true;
  banner.replaceChildren();
}

const MINUS = "\u2212";

/** Number with a fixed count of decimals and a real minus sign; a dash for what is unknown. */
export function fixed(value, decimals = 2) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** Number with about three significant figures. */
export function significant(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const places = value === 0 ? 0 : Math.max(0, digits - 1 - Math.floor(Math.log10(Math.abs(value))));
  return fixed(value, Math.min(places, 6));
}

/** `"no_peak_found"` as words. */
export function words(name) {
  return String(name).replaceAll("_", " ").replaceAll(":", ": ").replaceAll(",", ", ").replace(/ {2,}/g, " ");
}
