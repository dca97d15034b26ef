// Table of the dataset browser: one page of rows, sorted by the server.

import { columnWords } from "./filters.js";
import { dot, element, flagWords, significant } from "./ui.js";

/** Table in `container`; `onSort(column, descending)`, `onOpen(id, place)`. `draw(answer, sort, descending)` shows a page. */
export function makeTable(container, facts, colours, { onSort, onOpen }) {
  const byName = new Map(facts.columns.map((column) => [column.name, column]));
  const head = element("tr");
  const body = element("tbody", { id: "rows" });
  container.append(element("table", { class: "rows" }, element("thead", {}, head), body));
  return { draw };

  function draw(answer, sort, descending) {
    head.replaceChildren(...answer.columns.map((name) => heading(name, sort, descending)));
    body.replaceChildren(...answer.rows.map((row, n) => line(row, answer.columns, answer.offset + n)));
    if (!answer.rows.length) body.append(emptyLine(answer.columns.length));
  }

  function heading(name, sort, descending) {
    const column = byName.get(name) ?? { name, words: name, group: "example", unit: "", kind: "text" };
    const unit = column.unit ? element("small", {}, ` ${column.unit}`) : null;
    const again = sort === name && !descending;
    const button = element(
      "button", { type: "button", title: `sort by ${name}`, onclick: () => onSort(name, again) },
      columnWords(column, false), unit,
    );
    const order = sort !== name ? null : descending ? "descending" : "ascending";
    return element("th", { scope: "col", class: column.kind, "aria-sort": order, "data-column": name }, button);
  }

  function line(row, columns, place) {
    const cells = columns.map((name) => cell(row[name], name));
    return element(
      "tr",
      { tabindex: 0, "data-id": row.id, onclick: () => onOpen(row.id, place), onkeydown: (event) => onKey(event, row.id, place) },
      cells,
    );
  }

  function onKey(event, id, place) {
    if (event.key !== "Enter") return;
    event.preventDefault();
    onOpen(id, place);
  }

  function cell(value, name) {
    const kind = byName.get(name)?.kind ?? "text";
    if (name === "quality_flags") return element("td", { class: "flag-list", title: (value ?? "").split(";").map(flagWords).join("\n") }, short(value));
    const text = typeof value === "number" ? significant(value, 4) : value ?? "–";
    const spot = name === "label" && colours[value] ? dot(colours[value]) : null;
    return element("td", { class: kind, title: kind === "number" ? null : text }, spot, text);
  }
}

/** Buttons that go from page to page; `answer` is any with `n_matching` and `offset`. */
export function drawPages(container, answer, size, onPage) {
  const total = answer.n_matching;
  const [first, last] = [total ? answer.offset + 1 : 0, Math.min(answer.offset + size, total)];
  const step = (name, offset, disabled) => element(
    "button", { type: "button", id: `page-${name}`, disabled, onclick: () => onPage(Math.max(offset, 0)) }, name,
  );
  const [atStart, atEnd] = [answer.offset <= 0, answer.offset + size >= total];
  container.replaceChildren(
    step("first", 0, atStart), step("previous", answer.offset - size, atStart),
    element("output", {}, `${counted(Math.min(first, last))}–${counted(last)} of ${counted(total)}`),
    step("next", answer.offset + size, atEnd), step("last", lastPage(total, size), atEnd),
  );
}

/** First row of the last page. */
export function lastPage(total, size) {
  return Math.floor(Math.max(total - 1, 0) / size) * size;
}

/** A count with thin spaces between thousands. */
export function counted(number) {
  return String(number).replace(/\B(?=(\d{3})+$)/g, "\u202f");
}

function emptyLine(columns) {
  return element("tr", { class: "none" }, element("td", { colspan: columns, class: "text" }, "No row matches these filters."));
}

// The quantity is enough in a narrow column; the reason is in the title.
function short(flags) {
  const names = (flags ?? "").split(";").filter(Boolean).map((flag) => flagWords(flag.split(":")[0]));
  return [...new Set(names)].join(", ");
}
