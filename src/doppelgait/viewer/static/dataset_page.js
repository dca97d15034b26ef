// The dataset browser: filters beside counts, scatter, table and contact sheet; an example opens in the same place.

import { getJson, getPayload, isAborted } from "./api.js";
import * as asked from "./asked.js";
import { makeBalance } from "./balance.js";
import { makeFilters, addColumns } from "./filters.js";
import { makeScatter } from "./scatter.js";
import { makeSheet, SHEET_PAGE } from "./sheet.js";
import * as state from "./state.js";
import { counted, drawPages, lastPage, makeTable } from "./table.js";
import { clearError, element, field, showError } from "./ui.js";

const TABLE_PAGE = 50;
const STANDARD_AXES = ["feature_torso_velocity_mps", "feature_step_length_m"];

export async function show(container, session) {
  const facts = session.dataset;
  const list = element("div", { class: "dataset" });
  const opened = element("div", { class: "opened", hidden: true });
  container.replaceChildren(list, opened);
  const parts = layout(list, facts);
  const numbers = facts.columns.filter((column) => column.kind === "number").map((column) => column.name);
  const filters = makeFilters(parts.side, facts, session.class_colours, asked.setFilters);
  const balance = makeBalance(parts.figures, session.class_colours);
  const scatter = makeScatter(parts.figures, facts, session.class_colours, { onAxes: (axes) => state.set(axes), onOpen });
  const table = makeTable(parts.table, facts, session.class_colours, { onSort, onOpen });
  const sheet = makeSheet(parts.sheet, session, { onOpen });
  const sorting = makeSorting(parts.tools, facts, onSort);
  const stop = state.subscribe(changed);
  let example = null;
  let listed = false;
  checkAddress();
  await follow();
  return { destroy };

  function onSort(name, descending) {
    state.set({ sort: name, descending: name && descending ? 1 : null, offset: null }, { push: true });
  }

  /** Open an example; `place` is its place in the list where that is known. */
  function onOpen(id, place = null) {
    // the targets of a scene are one run; the number of a companion stands at the end of its id
    const companion = facts.origin === "simulated" ? /-c(\d+)$/.exec(id) : null;
    state.set({ example: id, at: place, target: companion?.[1] ?? null, segment: null, t: null }, { push: true });
  }

  /** Leave out of the address what this dataset does not know, and say so. */
  function checkAddress() {
    const out = asked.takeOutUnknown(facts);
    parts.leftOut.hidden = !out.length;
    parts.leftOut.textContent = `Ignored, because unknown in this dataset or contradictory: ${out.join(", ")}`;
  }

  function changed(names) {
    const filtered = [...names].some(asked.isFilter);
    if (filtered || names.has("sort")) checkAddress();
    const paged = ["sort", "descending", "offset", "view"].some((name) => names.has(name));
    if (names.has("example")) follow();
    if (state.get("example")) {
      if (filtered || paged) listed = false; // the list is made anew when the reader comes back to it
      return;
    }
    if (filtered) refresh();
    else if (paged) loadPage();
    if (names.has("x") || names.has("y")) loadScatter();
    if (names.has("map")) sheet.recolour();
  }

  /** Show the list or the example that the state names. */
  async function follow() {
    const id = state.get("example");
    list.hidden = Boolean(id);
    opened.hidden = !id;
    clearError();
    if (id) {
      await openExample(id);
      return;
    }
    example?.destroy();
    example = null;
    if (!listed) await refresh();
  }

  async function openExample(id) {
    const { showExample } = await import("./example_page.js");
    if (state.get("example") !== id) return;
    example ??= showExample(opened, session, { onBack, onOpen });
    example.open(id);
  }

  function onBack() {
    state.set({ example: null, at: null, target: null, segment: null, gate: null, t: null }, { push: true });
  }

  async function refresh() {
    clearError(); // its cause may be fixed now
    const wanted = asked.filters();
    // a form that says this already keeps its focus
    if (!listed || !sameFilters(filters.read(), wanted)) filters.show(wanted);
    listed = true;
    await Promise.all([loadBalance(), loadScatter(), loadPage()]);
  }

  function loadBalance() {
    return guarded(async () => {
      const answer = await getJson("api/balance", asked.query());
      parts.count.textContent = `${counted(answer.n_matching)} of ${counted(facts.n_rows)} rows`;
      balance.draw(answer);
    });
  }

  function loadScatter() {
    if (!numbers.length) return Promise.resolve();
    const order = [...STANDARD_AXES, ...numbers.filter((name) => name.startsWith("feature_")), ...numbers];
    const standard = [...new Set(order.filter((name) => numbers.includes(name)))];
    standard.push(standard[0]); // for a dataset with one number
    const [x, y] = ["x", "y"].map((axis, n) => (numbers.includes(state.get(axis)) ? state.get(axis) : standard[n]));
    return guarded(async () => scatter.draw(await getPayload("api/scatter", { ...asked.query(), x, y })));
  }

  function loadPage() {
    clearError();
    const asSheet = state.get("view") === "sheet";
    const size = asSheet ? SHEET_PAGE : TABLE_PAGE;
    const wanted = Math.min(Math.max(state.getNumber("offset", 0), 0), lastPage(facts.n_rows, size));
    const params = { ...asked.listed(), offset: Math.floor(wanted / size) * size, limit: size };
    sorting.show(params.sort, params.descending);
    parts.showView(asSheet);
    return guarded(async () => {
      const answer = await (asSheet ? getPayload("api/sheet", params, { key: "page" }) : getJson("api/rows", params, { key: "page" }));
      const { n_matching: total, offset } = asSheet ? answer.facts : answer;
      const last = lastPage(total, size);
      if (offset > last) { // an address of other times, or of other filters
        state.set({ offset: last || null }, { quiet: true });
        await loadPage();
        return;
      }
      if (asSheet) sheet.draw(answer);
      else table.draw(answer, params.sort, Boolean(params.descending));
      drawPages(parts.pages, { n_matching: total, offset }, size, (to) => state.set({ offset: to || null }, { push: true }));
    });
  }

  async function guarded(load) {
    try {
      await load();
      parts.main.dispatchEvent(new CustomEvent("shown"));
    } catch (error) {
      if (!isAborted(error)) showError(error);
    }
  }

  function destroy() {
    stop();
    example?.destroy();
    scatter.destroy();
    container.replaceChildren();
  }
}

function sameFilters(one, other) {
  const [first, second] = [one, other].map((pairs) => JSON.stringify(pairs.map((pair) => pair.join("=")).sort()));
  return first === second;
}

function layout(list, facts) {
  const [side, figures, tools] = ["dataset-side", "dataset-figures", "tools"].map((name) => element("div", { class: name }));
  const count = element("output", { id: "n-matching" });
  const pages = element("div", { class: "pages", role: "group", "aria-label": "Pages" });
  const table = element("div", { class: "table-frame", tabindex: 0, role: "region", "aria-label": "Rows" });
  const sheet = element("div", { class: "sheet-frame", hidden: true });
  const views = [["table", "Table"], ["sheet", "Contact sheet"]].map(([view, text]) => element(
    "button", { type: "button", id: `view-${view}`, onclick: () => state.set({ view: view === "table" ? null : view }, { push: true }) }, text,
  ));
  const rows = element(
    "section", { class: "panel panel-rows", "aria-label": "Rows" },
    element("header", {}, element("div", { class: "views", role: "group", "aria-label": "Show rows as" }, views), tools, pages),
    table, sheet,
  );
  const title = element("h1", {}, facts.name, " ", element("small", {}, facts.origin), " ", count);
  const warning = facts.complete ? null : element("p", { class: "warning" }, "Some of the planned examples could not be generated.");
  const leftOut = element("p", { id: "left-out", class: "warning", role: "status", hidden: true });
  const main = element("div", { class: "dataset-main" }, title, warning, leftOut, figures, rows);
  const narrow = matchMedia("(max-width: 760px)").matches; // there the filters would push everything off the screen
  list.append(element("details", { class: "dataset-filters panel", open: !narrow }, element("summary", {}, "Filters"), side), main);
  return { side, figures, tools, count, leftOut, pages, table, sheet, main, showView };

  function showView(asSheet) {
    table.hidden = asSheet;
    sheet.hidden = !asSheet;
    views.forEach((button, n) => button.setAttribute("aria-pressed", String((n === 1) === asSheet)));
  }
}

/** What the rows are sorted by, for both views. */
function makeSorting(holder, facts, onSort) {
  const select = element("select", { id: "sort" }, element("option", { value: "" }, "as built"));
  addColumns(select, facts.columns);
  const direction = element("button", { type: "button", id: "descending", "aria-pressed": "false" });
  const isDown = () => direction.getAttribute("aria-pressed") === "true";
  select.onchange = () => onSort(select.value, isDown());
  direction.onclick = () => onSort(select.value, !isDown());
  holder.append(field("sorted by", select), direction);
  return { show };

  function show(sort, descending) {
    select.value = sort ?? "";
    direction.disabled = !sort;
    direction.setAttribute("aria-pressed", String(Boolean(descending)));
    direction.textContent = descending ? "falling ↓" : "rising ↑";
  }
}
