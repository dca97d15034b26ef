// Filter form of the dataset browser. What is chosen leaves as [name, value] pairs, exactly what the server takes.

import { dot, element, flagWords, significant } from "./ui.js";

const USUAL = 8; // values of a category that are all shown as switches; more become a list to choose from
const TYPING_MS = 250; // after this pause what has been typed is meant

/** Form in `container`; `onChange(pairs)` is called whenever the reader has changed something. */
export function makeFilters(container, facts, colours, onChange) {
  const byName = new Map(facts.columns.map((column) => [column.name, column]));
  const shown = new Map();
  const changed = () => onChange(read());
  const text = textFilter(changed);
  const flags = flagFilter(facts.flags, changed);
  const blocks = element("div", { class: "filter-blocks" });
  const more = columnChooser("add-filter", "add a column …", facts.columns, (name) => add(name)?.focus());
  const clear = element("button", { type: "button", id: "clear-filters", onclick: onClear }, "Clear filters");
  const form = element(
    "form",
    { class: "filters", "aria-label": "Filters", onsubmit: (event) => event.preventDefault() },
    text.node, blocks, flags.node, labelled("more filters", more), clear,
  );
  container.append(form);
  return { read, show };

  function onClear() {
    show([]);
    changed();
  }

  function add(name) {
    const column = byName.get(name);
    if (!column || column.kind === "text") return null;
    if (!shown.has(name)) {
      const block = column.kind === "number" ? numberFilter(column, changed) : categoryFilter(column, colours, changed);
      shown.set(name, block);
      blocks.append(block.node);
    }
    return shown.get(name);
  }

  function read() {
    return [text, ...shown.values(), flags].flatMap((block) => block.read());
  }

  function show(pairs) {
    const names = pairs.map(([key]) => key.replace(/\.(min|max)$/, ""));
    blocks.replaceChildren();
    shown.clear();
    for (const name of new Set([...facts.filters, ...names])) add(name);
    for (const block of [text, ...shown.values(), flags]) block.show(pairs);
  }
}

/** Words of a column for a heading: what it is, and its unit. */
export function columnWords(column, withUnit = true) {
  const prefix = { truth: "true ", "standard deviation": "sd of " }[column.group] ?? "";
  return `${prefix}${column.words}${withUnit && column.unit ? ` (${column.unit})` : ""}`;
}

/** Fill a select with columns, in groups. */
export function addColumns(select, columns) {
  const groups = new Map();
  for (const column of columns) {
    if (!groups.has(column.group)) groups.set(column.group, element("optgroup", { label: column.group }));
    groups.get(column.group).append(element("option", { value: column.name }, columnWords(column)));
  }
  select.append(...groups.values());
}

function columnChooser(id, prompt, columns, choose) {
  const select = element("select", { id }, element("option", { value: "" }, prompt));
  addColumns(select, columns.filter((column) => column.kind !== "text"));
  select.onchange = () => {
    const name = select.value;
    select.value = "";
    if (name) choose(name);
  };
  return select;
}

function labelled(title, control) {
  return element("label", { class: "filter" }, element("span", {}, title), control);
}

function valuesOf(pairs, name) {
  return pairs.filter(([key]) => key === name).map(([, value]) => value);
}

function textFilter(changed) {
  let waiting = null;
  const input = element("input", {
    type: "search", id: "filter-text", placeholder: "part of the id", autocomplete: "off", onchange: now, oninput: soon,
  });
  return {
    node: labelled("id", input),
    read: () => (input.value ? [["text", input.value]] : []),
    show,
  };

  function now() {
    clearTimeout(waiting);
    changed();
  }

  function soon() {
    clearTimeout(waiting);
    waiting = setTimeout(() => input.isConnected && changed(), TYPING_MS);
  }

  function show(pairs) {
    clearTimeout(waiting);
    input.value = valuesOf(pairs, "text")[0] ?? "";
  }
}

function categoryFilter(column, colours, changed) {
  if (column.values.length > USUAL) return longCategoryFilter(column, changed);
  const name = column.name;
  const boxes = column.values.map((value) => element("input", { type: "checkbox", value, name, onchange: changed }));
  const chips = boxes.map((box, n) => {
    const value = column.values[n];
    const chip = element("label", { class: "chip" }, box, value);
    if (name === "label" && colours[value]) chip.append(dot(colours[value]));
    return chip;
  });
  return {
    node: element("fieldset", { class: "filter" }, element("legend", {}, columnWords(column)), chips),
    read: () => boxes.filter((box) => box.checked).map((box) => [name, box.value]),
    show: (pairs) => {
      const wanted = valuesOf(pairs, name);
      for (const box of boxes) box.checked = wanted.includes(box.value);
    },
    focus: () => boxes[0].focus(),
  };
}

function longCategoryFilter(column, changed) {
  const options = column.values.map((value) => element("option", { value }, value));
  const select = element("select", { multiple: true, size: 6, onchange: changed }, options);
  return {
    node: labelled(columnWords(column), select),
    read: () => options.filter((option) => option.selected).map((option) => [column.name, option.value]),
    show: (pairs) => {
      const wanted = valuesOf(pairs, column.name);
      for (const option of options) option.selected = wanted.includes(option.value);
    },
    focus: () => select.focus(),
  };
}

function numberFilter(column, changed) {
  const [low, high] = [["min", "at least", column.low], ["max", "at most", column.high]].map(([side, sense, end]) =>
    element("input", {
      type: "number", step: "any", name: `${column.name}.${side}`, placeholder: significant(end), onchange,
      "aria-label": `${columnWords(column)}, ${sense}`,
    }));
  const pair = element("div", { class: "pair" }, low, "to", high);
  const fault = element("p", { class: "fault", role: "status", hidden: true });
  return {
    node: element("fieldset", { class: "filter" }, element("legend", {}, columnWords(column)), pair, fault),
    read: () => (reason() ? [] : [low, high].filter((input) => input.value !== "").map((input) => [input.name, input.value])),
    show,
    focus: () => low.focus(),
  };

  function onchange() {
    mark();
    changed();
  }

  function show(pairs) {
    for (const input of [low, high]) input.value = valuesOf(pairs, input.name)[0] ?? "";
    mark();
  }

  /** Why these limits cannot be used, or null. */
  function reason() {
    if (low.validity.badInput || high.validity.badInput) return "This is no number";
    const crossed = low.value !== "" && high.value !== "" && low.valueAsNumber > high.valueAsNumber;
    return crossed ? "The first limit is above the second" : null;
  }

  function mark() {
    const found = reason();
    fault.textContent = found ? `${found}: not used.` : "";
    fault.hidden = !found;
    for (const input of [low, high]) input.setAttribute("aria-invalid", String(Boolean(found)));
  }
}

// One list each for what a row has and what it has not; further ones and patterns can come by the address.
function flagFilter(counts, changed) {
  const keys = ["flag", "no_flag"];
  const choices = [["", "any"], ["*", "any flag at all"]];
  choices.push(...Object.entries(counts).map(([flag, count]) => [flag, `${flagWords(flag)} (${count})`]));
  const selects = keys.map((key) => element(
    "select", { id: `filter-${key}`, onchange: changed }, choices.map(([value, text]) => element("option", { value }, text)),
  ));
  let others = [];
  return {
    node: element("div", { class: "filter-flags" }, labelled("with flag", selects[0]), labelled("without flag", selects[1])),
    read: () => [...keys.flatMap((key, n) => (selects[n].value ? [[key, selects[n].value]] : [])), ...others],
    show: (pairs) => {
      others = [];
      keys.forEach((key, n) => {
        const wanted = valuesOf(pairs, key);
        const known = wanted.find((value) => choices.some(([choice]) => choice === value));
        selects[n].value = known ?? "";
        others.push(...wanted.filter((value) => value !== known).map((value) => [key, value]));
      });
    },
  };
}
