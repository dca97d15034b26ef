// Keys of the run page, and the dialog that lists them.

import { SPEEDS } from "./clock.js";
import { element } from "./ui.js";

const KEYS = [
  ["space", "play or pause, unless a control that uses it has the focus (check box, button, list, text field)"],
  ["← →", "one step back or on (with shift: ten)"],
  ["Home End", "start, end"],
  ["+ −", "faster, slower"],
  ["l", "loop on or off"],
  ["[ ]", "target before, next target"],
  ["?", "this list"],
  ["in the scene", "drag or shift + arrows: turn; wheel, pinch or + −: zoom"],
  ["in the time pictures", "click or drag: move the cursor; shift + drag: scroll"],
  ["wheel", "zoom in time; over the numbers of the Doppler axis, or with alt, in Doppler; with shift: scroll"],
  ["double click, 0", "all of the time and Doppler axes"],
  ["z Z, a d", "zoom in and out, scroll in time"],
  ["y Y, s w", "zoom in and out, scroll in Doppler"],
  ["m, n, Esc", "measure between two points; annotate a span of time; end"],
];
const TYPING = "input:not([type=checkbox]), select, textarea, [contenteditable]";
const USES_SPACE = "button, select, summary, input:not([type=range]), textarea, [contenteditable]";

/** Listen for the keys of a clock and `further` ones; `moveTarget(±1)` chooses another target. Gives a function that ends it. */
export function listenToKeys(clock, moveTarget, further = {}) {
  const step = (event) => (event.shiftKey ? 10 : 1);
  const actions = {
    " ": () => clock.toggle(),
    ArrowLeft: (event) => clock.move(-step(event)),
    ArrowRight: (event) => clock.move(step(event)),
    Home: () => clock.seek(clock.start),
    End: () => clock.seek(clock.stop),
    "+": () => changeSpeed(clock, 1),
    "-": () => changeSpeed(clock, -1),
    l: () => clock.setLoop(!clock.loop),
    "[": () => moveTarget(-1),
    "]": () => moveTarget(1),
    ...further,
  };
  document.addEventListener("keydown", pressed);
  return () => document.removeEventListener("keydown", pressed);

  function pressed(event) {
    const target = event.target;
    const others = event.key === " " ? USES_SPACE : TYPING;
    if (event.ctrlKey || event.metaKey || event.altKey || target.closest?.(`${others}, dialog`)) return;
    if (event.key === "Enter" && target.matches?.("[type=checkbox]")) target.click();
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action(event);
  }
}

function changeSpeed(clock, by) {
  const place = SPEEDS.indexOf(clock.speed) + by;
  if (SPEEDS[place]) clock.setSpeed(SPEEDS[place]);
}

/** Fill the help dialog and open it with its button or "?". */
export function makeHelp(dialog, button) {
  const rows = KEYS.map(([key, action]) => element("tr", {}, element("th", {}, element("kbd", {}, key)), element("td", {}, action)));
  const close = element("button", { type: "button", onclick: () => dialog.close() }, "Close");
  dialog.replaceChildren(
    element("h2", { id: "help-title" }, "Keys and mouse"),
    element("table", {}, element("tbody", {}, rows)),
    close,
  );
  button.onclick = () => dialog.showModal();
  document.addEventListener("keydown", (event) => {
    if (event.key !== "?" || event.target.closest?.(TYPING) || dialog.open) return;
    event.preventDefault();
    dialog.showModal();
  });
}
