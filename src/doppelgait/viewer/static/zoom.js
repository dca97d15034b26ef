// Part of the time and of the Doppler axis that all panels show; kept in the address of the page.

import * as state from "./state.js";

const STEP = 1.4; // of one press of a key
const SHIFT = 0.2; // of what is shown

/** `time` and `doppler`, each with `limits(whole)`, `zoom(factor, at)`, `shift(by)`; `reset()` shows everything again. */
export function makeZoom(clock) {
  const time = makeAxis("time", 1e-3);
  const doppler = makeAxis("doppler", 0.1);
  const actions = {
    z: () => time.zoom(1 / STEP, clock.time),
    Z: () => time.zoom(STEP, clock.time),
    a: () => time.shift(-SHIFT * width(time.shown)),
    d: () => time.shift(SHIFT * width(time.shown)),
    y: () => doppler.zoom(1 / STEP, middle(doppler.shown)),
    Y: () => doppler.zoom(STEP, middle(doppler.shown)),
    s: () => doppler.shift(-SHIFT * width(doppler.shown)),
    w: () => doppler.shift(SHIFT * width(doppler.shown)),
    0: reset,
  };
  return { time, doppler, reset, follow, actions };

  function reset() {
    state.set({ time: null, doppler: null });
  }

  /** While playing the part of the time goes along with the cursor. */
  function follow() {
    const [from, to] = time.shown;
    if (clock.playing && (clock.time < from || clock.time > to)) time.shift(clock.time - from);
  }
}

function makeAxis(name, narrowest) {
  const axis = { shown: [0, 1], limits, zoom, shift };
  let whole = [0, 1];
  return axis;

  /** The part that is shown of an axis; all of it where none was chosen. */
  function limits(all) {
    whole = all;
    const chosen = /^(-?[\d.]+):(-?[\d.]+)$/.exec(state.get(name, ""))?.slice(1).map(Number);
    const fits = chosen && chosen[0] < chosen[1] && chosen[0] < all[1] && chosen[1] > all[0];
    axis.shown = fits ? chosen : all;
    return axis.shown;
  }

  function zoom(factor, at) {
    const [from, to] = axis.shown;
    const least = Math.max(factor, narrowest / (to - from));
    put(at - (at - from) * least, at + (to - at) * least);
  }

  function shift(by) {
    const [from, to] = axis.shown;
    const room = Math.min(Math.max(by, whole[0] - from), whole[1] - to);
    put(from + room, to + room);
  }

  function put(from, to) {
    const [low, high] = [Math.max(from, whole[0]), Math.min(to, whole[1])];
    axis.shown = [low, high];
    const all = high - low > 0.999 * (whole[1] - whole[0]);
    state.set({ [name]: all ? null : `${short(low)}:${short(high)}` });
  }
}

function short(value) {
  return Number(value.toFixed(4));
}

function width([from, to]) {
  return to - from;
}

function middle([from, to]) {
  return (from + to) / 2;
}
