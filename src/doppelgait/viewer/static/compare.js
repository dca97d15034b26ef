// A second recording below the first: the same time line and Doppler band, and its features; its colours have levels of their own.

import { getPayload, isAborted } from "./api.js";
import { makeFeatures } from "./features.js";
import { occupied } from "./picture.js";
import { makeRangeTime } from "./range_time.js";
import { makeSignature } from "./signature.js";

/** Panels of the second recording; `changed()` is called when its times or its band are known. */
export function makeCompare(page, changed) {
  const before = `${page.session.other}: `;
  const rangeTime = makeRangeTime(page, { id: "other-range-time", before });
  const signature = makeSignature(page, { id: "other-signature", before });
  const features = makeFeatures(page, { id: "other-features", before });
  const compare = {
    times: null, band: null, targets: [], name: page.session.other, panels: [rangeTime, signature, features], load, tick, redraw, destroy,
    stacked: [rangeTime.node, signature.node], features: features.node,
  };
  let job = 0;
  return compare;

  async function load(params) {
    const mine = ++job;
    const ask = (path) => getPayload(path, { ...params, run: 2 }, { key: `other ${path}` });
    try {
      const [recording, targets] = await Promise.all([ask("api/recording"), ask("api/targets")]);
      if (mine === job) show(recording, targets);
    } catch (error) {
      if (!isAborted(error) && mine === job) say(error.message);
    }
  }

  function show(recording, { facts, arrays }) {
    const { start_s: start, duration_s: duration } = recording.facts;
    const target = facts.targets[0] ?? null;
    const image = target?.signature;
    compare.times = [start, start + duration];
    compare.band = image ? occupied(image, arrays[image.array]) : null;
    compare.targets = facts.targets;
    rangeTime.show(recording);
    signature.showTruth(recording);
    rangeTime.showTargets({ targets: facts.targets, arrays, selected: 0 });
    say(target ? null : facts.reason);
    signature.show(image ? target : null, arrays);
    features.show(target, arrays);
    changed();
  }

  function say(reason) {
    for (const panel of [signature, features]) panel.say(reason);
  }

  function tick() {
    for (const panel of [rangeTime, signature]) panel.tick();
  }

  function redraw() {
    for (const panel of [rangeTime, signature]) panel.redraw();
  }

  function destroy() {
    job += 1;
    for (const panel of [rangeTime, signature]) panel.destroy();
  }
}
