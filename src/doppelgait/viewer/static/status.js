// A line that says what the page is waiting for, and since when.

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
