// A second recording below the first: the same time line and Doppler band, and its features; its colours have levels of their own.

import { getPayload, isAborted } from "./api.js";
import { makeDetail } from "./detail.js";
import { makeFeatures } from "./features.js";
import { makeRangeTime } from "./range_time.js";
import { makeSignature } from "./signature.js";

/** Panels of the second recording; `changed()` is called when its times or its band are known. */
export function makeCompare(page, changed) {
  const before = `${page.session.other}: `;
  const rangeTime = makeRangeTime(page, { id: "other-range-time", before });
  const signature = makeSignature(page, { id: "other-signature", before });
  const features = makeFeatures(page, { id: "other-features", before });
  const pictures = [rangeTime, signature];
  const compare = {
    times: null, band: null, targets: [], name: page.session.other, panels: [...pictures, features], load, refine, destroy,
    stacked: [rangeTime.node, signature.node], features: features.node,
    tick: () => pictures.forEach((panel) => panel.tick()),
    redraw: () => pictures.forEach((panel) => panel.redraw()),
  };
  const detail = makeDetail(page, { rangeTime, signature }, "other");
  let job = 0;
  return compare;

  async function load(params) {
    const mine = ++job;
    const ask = (path) => getPayload(path, { ...params, run: 2 }, { key: `other ${path}` });
    try {
      const recording = await ask("api/recording");
      if (mine !== job) return;
      showRecording(recording);
      const targets = await ask("api/targets");
      if (mine === job) show(recording, targets);
    } catch (error) {
      if (!isAborted(error) && mine === job) say(error.message);
    }
  }

  function showRecording(recording) {
    const { start_s: start, duration_s: duration } = recording.facts;
    compare.times = [start, start + duration];
    rangeTime.show(recording);
    signature.showTruth(recording);
    if (recording.facts.signature) showTarget({ signature: recording.facts.signature, overview: true }, recording.arrays);
  }

  function show(recording, { facts, arrays }) {
    const [target] = facts.targets;
    compare.targets = facts.targets;
    rangeTime.showTargets({ targets: facts.targets, arrays, selected: 0, overview: recording.facts });
    features.say(target ? null : facts.reason);
    if (target) showTarget(target, arrays);
    else if (!recording.facts.signature) signature.say(facts.reason);
    features.show(target ?? null, arrays);
  }

  function showTarget(target, arrays) {
    const image = target.signature;
    compare.band = image?.band_hz ?? null;
    signature.say(null);
    signature.show(image ? target : null, arrays);
    changed();
  }

  function refine(params) {
    detail.follow({ ...params, run: 2, target: compare.targets[0]?.gate_limits ? 0 : null });
  }

  function say(reason) {
    for (const panel of [signature, features]) panel.say(reason);
  }

  function destroy() {
    job += 1;
    detail.destroy();
    for (const panel of pictures) panel.destroy();
  }
}
