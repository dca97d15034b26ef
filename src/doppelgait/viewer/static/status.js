// What a page says about its run: what it waits for and since when; notes and warnings, each sentence once, in one line.

import { element } from "./ui.js";

const PATIENCE_MS = 400; // what takes less needs no words

/** `node`, and `begin(words)`, `end()`: between them it shows `words()` and the seconds since the first of them. */
export function makeStatus() {
  const [said, since] = [element("span"), element("span", { "aria-hidden": "true" })]; // each second is not read out
  const node = element("output", { id: "status", class: "status" }, said, since);
  let began = 0;
  let timer = null;
  return { node, begin, end };

  function begin(words) {
    end();
    began = performance.now();
    timer = setTimeout(function say() {
      const seconds = Math.floor((performance.now() - began) / 1000);
      if (said.textContent !== words()) said.textContent = words();
      since.textContent = seconds ? ` … ${seconds} s` : " …";
      timer = setTimeout(say, 500);
    }, PATIENCE_MS);
  }

  function end() {
    clearTimeout(timer);
    for (const part of [said, since]) part.textContent = "";
  }
}

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
