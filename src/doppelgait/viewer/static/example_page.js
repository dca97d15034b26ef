// An example of the dataset, opened: the page of its run below a bar that leads back and on.

import { getJson, isAborted } from "./api.js";
import { listed } from "./asked.js";
import { showRun } from "./run_page.js";
import * as state from "./state.js";
import { element, showError } from "./ui.js";

const TRACKED = "The gate followed a track, which the dataset does not store: no gate is shown.";
const ANEW = "Choose another gate than “as stored” to analyse the example again.";

/** Bar and run in `container`; `open(id)` shows an example, `onOpen(id, place)` is called for the one before or behind it. */
export function showExample(container, session, { onBack, onOpen }) {
  const name = element("strong", { id: "example-id" });
  const step = (id, text) => element("button", { type: "button", id }, text);
  const [back, previous, next] = [step("back", "← all rows"), step("example-previous", "previous"), step("example-next", "next")];
  const bar = element("div", { class: "example-bar" }, back, name, previous, next);
  const note = element("p", { id: "gate-note", class: "faint example-note", hidden: true });
  const holder = element("div", {});
  // a gate of one's own is analysed anew; without one the stored arrays are shown
  const simulated = session.dataset.origin === "simulated";
  const own = { ...session, default_gate: "stored" };
  const gateColumn = session.dataset.columns.find((column) => column.name === "gate");
  container.replaceChildren(bar, note, holder);
  let run = null;
  let shown = null; // id
  let tracked = false;
  back.onclick = onBack;
  const stop = state.subscribe((names) => names.has("gate") && drawNote());
  return { open, destroy };

  function open(id) {
    shown = id;
    name.textContent = id;
    tracked = false;
    drawNote();
    follow({});
    if (run) run.update({ example: id });
    else run = showRun(holder, { example: id }, own);
    guarded(id, () => neighboursOf(id, state.getNumber("at")), follow);
    if (gateColumn?.values?.includes("track")) guarded(id, () => isTracked(id), (found) => { tracked = found; drawNote(); });
  }

  /** Let the buttons lead to the neighbours; what is not known leads nowhere. */
  function follow({ place, previous: before, next: behind }) {
    for (const [button, to, where] of [[previous, before, place - 1], [next, behind, place + 1]]) {
      button.disabled = to === undefined;
      button.onclick = () => onOpen(to, where);
    }
    if (place !== undefined) state.set({ at: place }, { quiet: true });
  }

  function drawNote() {
    note.hidden = !tracked || Boolean(state.get("gate"));
    note.textContent = simulated ? `${TRACKED} ${ANEW}` : TRACKED;
  }

  async function guarded(id, ask, take) {
    try {
      const answer = await ask();
      if (shown === id) take(answer);
    } catch (error) {
      if (!isAborted(error) && shown === id) showError(error);
    }
  }

  function destroy() {
    shown = null;
    stop();
    run?.destroy();
    container.replaceChildren();
  }
}

/** Whether the gate of an example was a track's; a part of another id may be this id. */
async function isTracked(id) {
  const { rows } = await getJson("api/rows", { gate: "track", text: id, limit: 500 }, { key: "tracked" });
  return rows.some((row) => row.id === id);
}

const CHUNK = 500; // rows of one request; the server gives no more
const MOST = 20; // requests for one example

/**
 * `{place, previous, next}` of an example; ids are undefined at the ends, all of them where it is not in the list.
 * `guess` is the place where it was last seen; without a right one the list is searched from its start.
 */
async function neighboursOf(id, guess) {
  if (Number.isInteger(guess) && guess >= 0) {
    const found = await within(id, Math.max(guess - 1, 0), 3);
    if (found.place === guess) return found;
  }
  for (let n = 0, end = 1; n < MOST && n * CHUNK < end; n += 1) {
    const found = await within(id, n * CHUNK, CHUNK);
    if (found.place !== undefined) return around(id, found);
    end = found.end;
  }
  return {};
}

/** Look for an example in a section of the list. */
async function within(id, offset, limit) {
  const answer = await getJson("api/rows", { ...listed(), offset, limit }, { key: "neighbours" });
  const ids = answer.rows.map((row) => row.id);
  const n = ids.indexOf(id);
  const found = { end: answer.n_matching };
  return n < 0 ? found : { ...found, place: offset + n, previous: ids[n - 1], next: ids[n + 1] };
}

/** At the edge of a chunk one of the neighbours lies in the next one. */
function around(id, found) {
  const lacks = (found.previous === undefined && found.place > 0) || (found.next === undefined && found.place + 1 < found.end);
  return lacks ? within(id, found.place - 1, 3) : found;
}
