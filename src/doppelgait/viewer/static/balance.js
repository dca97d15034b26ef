// Class balance: matching rows of every class in every split, as numbers on bars.

import { counted } from "./table.js";
import { dot, element } from "./ui.js";

/** Table in `container`; `draw(answer)` takes `{splits, counts}`. */
export function makeBalance(container, colours) {
  const table = element("table", { id: "balance", class: "balance" });
  const node = element(
    "section", { class: "panel panel-balance", "aria-label": "Class balance" },
    element("header", {}, element("h2", {}, "Class balance")), table,
  );
  container.append(node);
  return { draw };

  function draw({ splits, counts }) {
    const largest = Math.max(1, ...Object.values(counts).flat());
    const head = element("tr", {}, ["class", ...splits, "all"].map((name) => element("th", { scope: "col" }, name)));
    const lines = Object.entries(counts).map(([label, numbers]) => element(
      "tr", { "data-class": label },
      element("th", { scope: "row" }, colours[label] ? dot(colours[label]) : null, label),
      numbers.map((number) => bar(number, number / largest, colours[label])),
      element("td", {}, counted(sum(numbers))),
    ));
    const totals = splits.map((_, n) => element("td", {}, counted(sum(Object.values(counts).map((numbers) => numbers[n])))));
    const all = element("td", {}, counted(sum(Object.values(counts).flat())));
    const foot = element("tr", {}, element("th", { scope: "row" }, "all"), totals, all);
    table.replaceChildren(element("thead", {}, head), element("tbody", {}, lines), element("tfoot", {}, foot));
  }
}

function bar(number, share, colour) {
  const fill = element("span", { class: "bar-fill", "aria-hidden": "true" });
  fill.style.width = `${100 * share}%`;
  fill.style.backgroundColor = colour ?? "#888888";
  return element("td", { class: "bar-cell" }, fill, element("span", {}, counted(number)));
}

function sum(numbers) {
  return numbers.reduce((total, number) => total + number, 0);
}
