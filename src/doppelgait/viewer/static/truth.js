// Which of the bodies in a simulated recording a target is.

import { cellAt } from "./picture.js";

const FURTHEST_M = 0.8; // the same as the server's, for the true values beside the features

/**
 * Number of the body with the range nearest to the middle of a target's gate, in the median of the times shown; null
 * where none is near. `truth` is {list, arrays} as the recording's payload has them.
 */
export function bodyOf(target, arrays, { list, arrays: truths }) {
  if (!target.gate_limits) return list.length === 1 ? 0 : null;
  const times = arrays[target.gate_limits.time];
  const [low, high] = [arrays[target.gate_limits.low], arrays[target.gate_limits.high]];
  let best = null;
  for (const [number, { range, time }] of list.entries()) {
    if (!range || !time) continue;
    const away = [];
    for (let n = 0; n < times.length; n += 1) {
      const cell = cellAt(time, times[n]);
      const distance = cell === null ? NaN : Math.abs((low[n] + high[n]) / 2 - truths[range][cell]);
      if (Number.isFinite(distance)) away.push(distance);
    }
    const median = away.sort((a, b) => a - b)[away.length >> 1] ?? Infinity;
    if (median < FURTHEST_M && median < (best?.median ?? Infinity)) best = { number, median };
  }
  return best?.number ?? null;
}
