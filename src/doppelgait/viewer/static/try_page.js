// "Try it": change who moves, how and before which radar, and see at once what that does.

import { getJson, isAborted } from "./api.js";
import { showRun } from "./run_page.js";
import * as state from "./state.js";
import { makeTryForm } from "./try_form.js";
import { element } from "./ui.js";

/** Show the page in a container; gives `{destroy()}`. */
export async function show(container, session) {
  const form = makeTryForm(session.try_controls, state, changed);
  const status = element("p", { id: "try-status", class: "try-status", role: "status" });
  const below = element("div", { class: "try-run" });
  let run = null;
  let shown = null; // text of the parameters on the page
  let first = true;
  let busy = false;
  let ended = false;
  let scene = "";
  const copy = element("button", { id: "try-copy", type: "button", disabled: true, onclick: copyScene }, "copy as scene file");
  copy.title = "A file for the command: doppelgait simulate scene.toml -o recording.h5";
  form.node.append(element("div", { class: "try-foot" }, copy, status));
  container.replaceChildren(element("div", { class: "try" }, form.node, below));
  const stop = state.subscribe((names) => form.restore(names));
  changed();
  return { destroy };

  /** Simulate what the form says; while one is on its way only the newest of the rest is kept. */
  async function changed() {
    if (busy) return;
    busy = true;
    try {
      while (!ended && JSON.stringify(form.values()) !== shown) await redraw(form.values());
    } finally {
      busy = false;
    }
  }

  async function redraw(values) {
    const began = performance.now();
    shown = JSON.stringify(values);
    const reference = { try: 1, ...values };
    container.classList.add("busy");
    try {
      const answer = await getJson("api/scene", reference);
      if (ended) return;
      offer(answer.toml);
      if (run) await run.update(reference);
      else run = showRun(below, reference, session);
      say(first ? "" : `redrawn in ${Math.round(performance.now() - began)} ms`);
      first = false;
    } catch (error) {
      if (isAborted(error)) return;
      offer(""); // what was copied would be the run before
      say(error.message, "fault");
    } finally {
      container.classList.remove("busy");
    }
  }

  function offer(toml) {
    scene = toml;
    copy.disabled = toml === "";
  }

  function say(words, kind = "") {
    status.className = `try-status ${kind}`;
    status.replaceChildren(words);
  }

  async function copyScene() {
    try {
      await navigator.clipboard.writeText(scene);
      say("The scene file is on the clipboard: save it as scene.toml");
    } catch {
      showText();
    }
  }

  /** Where the clipboard is closed to pages: the text to copy by hand. */
  function showText() {
    const area = element("textarea", { id: "try-toml", rows: 14, readonly: true, "aria-label": "Scene file" });
    area.value = scene;
    status.replaceChildren(area);
    area.select();
  }

  function destroy() {
    ended = true;
    stop();
    run?.destroy();
  }
}
