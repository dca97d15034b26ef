// Notes and warnings of a run: each sentence once, in one line of fixed height; a click shows all of them.

import { element } from "./ui.js";

export function makeNotes() {
  const first = element("summary", {});
  const list = element("ul", { "aria-label": "Notes and warnings" });
  const node = element("details", { id: "notes", class: "notes" }, first, list);
  const known = {}; // sentences by where they come from
  return { node, show };

  function show(source, sentences) {
    known[source] = sentences;
    const all = [...new Set(Object.values(known).flat())];
    list.replaceChildren(...all.map((sentence) => element("li", {}, sentence)));
    first.textContent = all.length > 1 ? `${all.length} notes: ${all[0]} …` : all[0] ?? "";
    first.title = all.join("\n");
    node.classList.toggle("none", !all.length);
  }
}
