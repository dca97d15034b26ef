// An example of the dataset, opened: the page of its run below a bar that leads back and on.

import { showRun } from "./run_page.js";
import { element } from "./ui.js";

/** Bar and run in `container`; `open(id, ids)` shows an example, `ids` are those of the list that it came from. */
export function showExample(container, session, { onBack, onOpen }) {
  const name = element("strong", { id: "example-id" });
  const step = (id, text) => element("button", { type: "button", id }, text);
  const [back, previous, next] = [step("back", "← all rows"), step("example-previous", "previous"), step("example-next", "next")];
  const bar = element("div", { class: "example-bar" }, back, name, previous, next);
  const holder = element("div", {});
  // a gate of one's own is analysed anew; without one the stored arrays are shown
  const gates = session.dataset.origin === "simulated" ? ["stored", "track", "truth"] : ["stored"];
  const own = { ...session, gates, default_gate: "stored" };
  container.replaceChildren(bar, holder);
  let run = null;
  back.onclick = onBack;
  return { open, destroy };

  function open(id, ids) {
    name.textContent = id;
    const place = ids.indexOf(id);
    for (const [button, to] of [[previous, ids[place - 1]], [next, place < 0 ? undefined : ids[place + 1]]]) {
      button.disabled = to === undefined;
      button.onclick = () => onOpen(to);
    }
    if (run) run.update({ example: id });
    else run = showRun(holder, { example: id }, own);
  }

  function destroy() {
    run?.destroy();
    container.replaceChildren();
  }
}
