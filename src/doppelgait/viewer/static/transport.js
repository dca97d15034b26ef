// Play, pause, scrub, speed, loop: the controls of the clock.

import { SPEEDS } from "./clock.js";
import * as state from "./state.js";
import { element, field, fillSelect, fixed } from "./ui.js";

/** Bar with the controls of a clock; `node` also takes what others hang in (the sound). */
export function makeTransport(clock) {
  const play = element("button", { id: "play", type: "button", class: "play", "aria-pressed": "false", onclick: clock.toggle });
  const scrub = element("input", { id: "scrub", type: "range", "aria-label": "Time in s", oninput: () => clock.seek(scrub.valueAsNumber) });
  const time = element("output", { id: "time", class: "time" });
  const end = element("span", { class: "unit" });
  const speed = element("select", { id: "speed", onchange: () => clock.setSpeed(Number(speed.value)) });
  const loop = element("input", { id: "loop", type: "checkbox", onchange: () => clock.setLoop(loop.checked) });
  fillSelect(speed, SPEEDS.map((value) => [value, `${value} ×`]), clock.speed);
  const node = element(
    "div",
    { class: "transport", role: "group", "aria-label": "Time" },
    play,
    scrub,
    element("span", { class: "clock" }, time, end),
    field("speed", speed),
    field("loop", loop),
  );
  clock.subscribe(follow);
  follow();
  return { node, play };

  function follow() {
    const label = clock.playing ? "Pause" : "Play";
    if (play.textContent !== label) {
      play.textContent = label;
      play.setAttribute("aria-pressed", String(clock.playing));
      play.title = `${label} (space)`;
    }
    if (scrub.max !== String(clock.stop) || scrub.min !== String(clock.start)) {
      Object.assign(scrub, { min: clock.start, max: clock.stop, step: clock.step / 10 });
      end.textContent = ` / ${fixed(clock.stop, 2)} s`;
    }
    if (document.activeElement !== scrub || clock.playing) scrub.value = clock.time;
    time.textContent = fixed(clock.time, 3);
    if (speed.value !== String(clock.speed)) speed.value = clock.speed;
    if (loop.checked !== clock.loop) loop.checked = clock.loop;
    if (clock.ready && !clock.playing) keep();
  }

  function keep() {
    const time = clock.time > clock.start ? clock.time.toFixed(3) : null;
    state.set({ t: time, speed: clock.speed === 1 ? null : clock.speed, loop: clock.loop ? null : "0" }, { quiet: true });
  }
}

/** Take time, speed and loop from the address of the page. */
export function restoreClock(clock) {
  const speed = state.getNumber("speed", 1);
  clock.speed = SPEEDS.includes(speed) ? speed : 1;
  clock.loop = state.get("loop") !== "0";
  const time = state.getNumber("t", clock.start);
  clock.ready = true; // from here on its changes go into the address
  clock.seek(time);
}
