// The sound of the chosen target, in step with the clock.

import { address, getBlob, isAborted } from "./api.js";
import * as state from "./state.js";
import { element, field, fillSelect, showError } from "./ui.js";

const PITCHES = [["", "auto"], ["1", "1 ×"], ["2", "2 ×"], ["4", "4 ×"], ["8", "8 ×"], ["16", "16 ×"], ["40", "40 ×"]];
const EARS = [["", "I | Q"], ["sides", "approaching | receding"]];
const MOST_DRIFT_S = 0.04;

const TITLE = "Hear the Doppler signal of the target while playing";

/**
 * Hang the sound into a transport; `named()` gives the parameters that name the run and its gate as they are now.
 * `refuse(reason)` puts the button out of use, with the reason beside it; null puts it back.
 *
 * The clock leads: the sound plays, pauses, seeks and changes its speed with it, and is set right where it drifts.
 */
export function attachSound(transport, clock, named) {
  const audio = element("audio", { id: "sound-audio" });
  const button = element(
    "button",
    { id: "sound", type: "button", "aria-pressed": "false", title: TITLE, onclick: toggle },
    "Sound",
  );
  const pitch = choice("pitch", PITCHES);
  const ears = choice("ears", EARS);
  const choices = [
    field("pitch", pitch, "Factor for every Doppler frequency; auto: 4, or the largest that the audio rate allows"),
    field("ears", ears, "Left | right: real and imaginary part, or approaching and receding motion"),
  ];
  const nodes = [button, ...choices, audio];
  let on = false;
  let loaded = null; // address of what the audio element holds
  let wanted = null; // address of what is being fetched
  transport.node.append(...nodes);
  show();
  audio.preservesPitch = false;
  const stops = [clock.subscribe(follow), state.subscribe((names) => ["target", "pitch", "ears"].some((name) => names.has(name)) && renew())];
  return { renew, refuse, destroy, audio };

  function choice(name, choices) {
    const select = element("select", { id: `sound-${name}`, onchange: () => state.set({ [name]: select.value }) });
    fillSelect(select, choices, choices.some(([value]) => value === state.get(name, "")) ? state.get(name, "") : "");
    return select;
  }

  function toggle() {
    on = !on;
    show();
    if (on) renew();
    else audio.pause();
  }

  function refuse(reason) {
    if (reason && on) toggle();
    button.disabled = Boolean(reason);
    button.title = reason ?? TITLE;
    button.setAttribute("aria-description", reason ?? "");
  }

  function show() {
    button.setAttribute("aria-pressed", String(on));
    for (const one of choices) one.hidden = !on;
  }

  function parameters() {
    return { ...named(), target: state.get("target"), pitch: pitch.value, channels: ears.value };
  }

  /** Fetch what is to be heard now, unless it is there already. */
  async function renew() {
    if (!on) return;
    const next = address("api/sound", parameters()).href;
    if (next === wanted || (next === loaded && !wanted)) return follow();
    wanted = next;
    button.setAttribute("aria-busy", "true");
    try {
      const blob = await getBlob("api/sound", parameters());
      if (wanted !== next) return;
      wanted = null;
      put(blob, next);
    } catch (error) {
      if (isAborted(error) || wanted !== next) return;
      wanted = null;
      if (on) toggle();
      showError(error);
    } finally {
      if (!wanted) button.removeAttribute("aria-busy");
    }
  }

  function put(blob, name) {
    release();
    audio.src = URL.createObjectURL(blob);
    loaded = name;
    follow();
  }

  function release() {
    if (audio.src) URL.revokeObjectURL(audio.src);
    audio.removeAttribute("src");
    loaded = null;
  }

  /** Take over time, speed and play or pause of the clock. */
  function follow() {
    if (!on || !loaded) return;
    const time = clock.time - clock.start;
    if (audio.playbackRate !== clock.speed) audio.playbackRate = clock.speed;
    const audible = clock.playing && time < (audio.duration || Infinity) - 0.01;
    if (!audio.seeking && Math.abs(audio.currentTime - time) > MOST_DRIFT_S * Math.max(clock.speed, 1)) audio.currentTime = time;
    if (audible && audio.paused) audio.play().catch(refused);
    if (!audible && !audio.paused) audio.pause();
  }

  /** A browser that plays nothing before a click says so; a play that a pause has overtaken is no fault. */
  function refused(error) {
    if (error.name !== "NotAllowedError" || !on) return;
    toggle();
    showError(new Error("The browser plays no sound before you have clicked somewhere: press Sound again."));
  }

  function destroy() {
    on = false;
    audio.pause();
    release();
    for (const stop of stops) stop();
    for (const node of nodes) node.remove();
  }
}
