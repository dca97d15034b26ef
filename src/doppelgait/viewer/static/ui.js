// Small parts of the page. Text from data always goes in as text, never as HTML.

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

/** A spot in the colour of a class or a track, or the swatch of a line. */
export function dot(colour, kind = "dot") {
  const spot = element("span", { class: kind, "aria-hidden": "true" });
  spot.style.backgroundColor = colour;
  return spot;
}

/** Panel of a kind with a title, a read-out for the mouse (`hover-NAME`), a place for a colour bar, and a body. */
export function makePanel(name, title, kind = name) {
  const heading = element("h2", {}, title);
  const hover = element("output", { id: `hover-${name}`, class: "hover", "aria-live": "off" });
  const tools = element("div", { class: "tools" });
  const body = element("div", { class: "plot" });
  const note = element("p", { class: "empty", hidden: true });
  const node = element(
    "section",
    { class: `panel panel-${kind}`, id: name === kind ? null : `panel-${name}`, "aria-label": title },
    element("header", {}, heading, hover, tools),
    body,
    note,
  );
  return { node, body, hover, tools, heading, say };

  /** Show a sentence in place of the picture; null shows the picture again. */
  function say(words) {
    note.textContent = words ?? "";
    note.hidden = !words;
    body.hidden = Boolean(words);
    node.classList.toggle("nothing", Boolean(words)); // gives its space to the others
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

/** Number with about three significant figures; what rounding alone keeps from zero is zero. */
export function significant(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (Math.abs(value) < 5e-7) return "0";
  const places = value === 0 ? 0 : Math.max(0, digits - 1 - Math.floor(Math.log10(Math.abs(value))));
  return fixed(value, Math.min(places, 6));
}

const SPELLED = { db: "dB", doppler: "Doppler", snr: "SNR", rcs: "RCS", cpi: "CPI", prf: "PRF", hz: "Hz" };

/** `"no_peak_6_db_above"` as words: names and units are spelled as they are elsewhere. */
export function words(name) {
  const spaced = String(name).replaceAll("_", " ").replaceAll(":", ": ").replaceAll(",", ", ").replace(/ {2,}/g, " ");
  return spaced.replace(/\b(db|doppler|snr|rcs|cpi|prf|hz)\b/g, (word) => SPELLED[word]);
}

/** A flag, `"quantities:reason"`, as words: the quantities go without the unit that their names end in. */
export function flagWords(flag) {
  const [names, ...reasons] = String(flag).split(":");
  const quantities = names
    .split(",")
    .map((name) => name.replace(/_(mps|hz|m|s|db|deg|m2|kg)$/, ""))
    .map((name) => name.replace("harmonic_ratio_2", "second harmonic ratio").replace("harmonic_ratio_3", "third harmonic ratio"));
  return words([quantities.join(","), ...reasons].join(":"));
}

/** Start and end of a span, "12.0–24.5 s"; nothing where there is none. */
export function span(ends) {
  return ends ? `${fixed(ends[0], 1)}–${fixed(ends[1], 1)} s` : "";
}

/** Span in s of the segment that a target's pictures and numbers come from; null for the whole recording. */
export function shownSegment(target) {
  return target?.segments?.[target.segment ?? -1] ?? null;
}
