// The page of one run: a recording, a result, an example of a dataset, or what "Try it" has simulated.

import { getPayload, isAborted } from "./api.js";
import { makeCadence } from "./cadence.js";
import { makeClock } from "./clock.js";
import { makeControls } from "./controls.js";
import { makeFeatures } from "./features.js";
import { listenToKeys } from "./keyboard.js";
import { edges, occupied } from "./picture.js";
import { makeRangeDoppler } from "./range_doppler.js";
import { makeRangeTime } from "./range_time.js";
import { makeScene } from "./scene.js";
import { makeSignature } from "./signature.js";
import * as state from "./state.js";
import { makeTransport, restoreClock } from "./transport.js";
import { clearError, element, showError } from "./ui.js";

/**
 * Show a run in a container.
 *
 * `reference` holds the parameters that name it (see the server's run references). Gives `{update(reference), destroy()}`;
 * `update` takes another run into the same panels, which keep their old pictures until the new ones have come.
 */
export function showRun(container, reference, session) {
  const clock = makeClock();
  const page = { session, clock, band: () => band() };
  const panels = {
    rangeTime: makeRangeTime(page), signature: makeSignature(page), scene: makeScene(page),
    rangeDoppler: makeRangeDoppler(page), cadence: makeCadence(page), features: makeFeatures(page),
  };
  const transport = makeTransport(clock);
  const controls = makeControls(session);
  const facts = element("dl", { id: "facts", class: "facts", "aria-label": "The recording" });
  const notes = element("ul", { class: "notes", "aria-label": "Notes" });
  const warnings = element("ul", { class: "notes", "aria-label": "Warnings of the analysis" });
  const node = element("div", { class: "run" }, transport.node, controls.node, facts, notes, warnings, layout(panels));
  let targets = { targets: [], arrays: {}, selected: 0 };
  let doppler = null; // limits of all Doppler axes
  let restored = false; // whether the time has been taken from the address
  let job = 0; // number of the newest load; answers to older ones are dropped
  const endings = [
    clock.subscribe(tick), state.subscribe(changed), listenToKeys(clock, moveTarget), controls.destroy, clock.destroy,
  ];
  let sound = null;
  container.replaceChildren(node);
  load();
  hangSound();
  return { update, destroy, clock };

  function update(next) {
    reference = next;
    return load();
  }

  async function load() {
    const mine = ++job;
    clearError();
    node.classList.add("loading");
    const results = loadTargets(mine); // at the same time: the analysis takes longest
    const recording = await loadRecording(mine);
    await results;
    if (mine !== job) return;
    if (recording && recording.facts.duration_s === null) withoutRecording();
    node.classList.remove("loading");
    sound?.renew();
  }

  async function loadRecording(mine) {
    try {
      const recording = await getPayload("api/recording", { ...named(), ...clutter() });
      if (mine !== job) return null;
      showRecording(recording);
      panels.rangeDoppler.load(named(), recording.facts.reason);
      return recording;
    } catch (error) {
      if (!isAborted(error)) showError(error);
      return null;
    }
  }

  /** Results without their recording: the signature says how long they are. */
  function withoutRecording() {
    const signature = targets.targets[targets.selected]?.signature;
    if (signature) setTime(...edges(signature.x));
  }

  /** Parameters of the run and its gate. */
  function named() {
    return { ...reference, gate: state.get("gate") };
  }

  async function loadTargets(mine) {
    try {
      const answer = await getPayload("api/targets", named());
      if (mine === job) showTargets(answer);
    } catch (error) {
      if (!isAborted(error) && mine === job) withoutTargets(error.message);
    }
  }

  function clutter() {
    return { clutter: state.get("clutter") === "kept" ? "kept" : "removed" };
  }

  function showRecording(recording) {
    const { start_s: start, duration_s: duration } = recording.facts;
    if (duration !== null) setTime(start, start + duration);
    showFacts(recording.facts);
    controls.fillGates(recording.facts);
    panels.rangeTime.show(recording);
    panels.scene.show(recording);
    panels.signature.showTruth(recording);
    performance.mark("recording-shown");
  }

  function setTime(start, stop) {
    clock.setRange(start, stop, Math.min((stop - start) / 100, 0.02));
    if (!restored) restoreClock(clock);
    restored = true;
  }

  function showFacts({ facts: pairs, notes: sentences, reason }) {
    facts.replaceChildren(...pairs.map(([name, value]) => element("div", {}, element("dt", {}, name), element("dd", {}, value))));
    list(notes, [reason, ...sentences].filter(Boolean));
  }

  function list(node, sentences) {
    node.replaceChildren(...sentences.map((sentence) => element("li", {}, sentence)));
  }

  function showTargets({ facts: { targets: found, reason, notes: said }, arrays }) {
    targets = { targets: found, arrays, selected: 0 };
    list(warnings, said ?? []);
    clearError();
    if (!found.length) withoutTargets(reason ?? "No target was found.");
    else select();
    performance.mark("targets-shown");
  }

  function withoutTargets(reason) {
    targets = { targets: [], arrays: {}, selected: 0 };
    doppler = null;
    select();
    for (const panel of [panels.signature, panels.cadence, panels.features]) panel.say(reason);
  }

  /** Show the target that the state names. */
  function select() {
    const wanted = state.getNumber("target", 0);
    targets.selected = targets.targets[wanted] ? wanted : 0;
    const target = targets.targets[targets.selected] ?? null;
    const { arrays } = targets;
    controls.fillTargets(targets.targets, targets.selected);
    doppler = target?.signature ? occupied(target.signature, arrays[target.signature.array]) : null;
    showOrSay(panels.signature, target?.signature, "The signature of this target was not kept.", target, arrays);
    showOrSay(panels.cadence, target?.cadence_map, "The step-Doppler map of this target was not kept.", target, arrays);
    showOrSay(panels.features, target, null, target, arrays);
    for (const panel of [panels.rangeTime, panels.rangeDoppler, panels.scene]) panel.showTargets(targets);
  }

  function showOrSay(panel, there, reason, target, arrays) {
    panel.say(there ? null : reason);
    panel.show(there ? target : null, arrays);
  }

  function band() {
    const signature = targets.targets[targets.selected]?.signature;
    return state.get("band") === "all" && signature ? edges(signature.y) : doppler;
  }

  function moveTarget(by) {
    const count = targets.targets.length;
    if (count) state.set({ target: (targets.selected + by + count) % count || null });
  }

  function tick() {
    for (const panel of [panels.rangeTime, panels.signature, panels.scene, panels.rangeDoppler]) panel.tick();
  }

  function redraw() {
    for (const panel of [panels.rangeTime, panels.signature, panels.rangeDoppler, panels.cadence]) panel.redraw();
  }

  function changed(names) {
    if (names.has("gate")) load();
    else if (names.has("target")) select();
    if (names.has("clutter")) loadRangeTime();
    if (["map", "lo", "hi", "band"].some((name) => names.has(name))) redraw();
    if (names.has("t")) clock.seek(state.getNumber("t", clock.start));
  }

  async function loadRangeTime() {
    try {
      panels.rangeTime.show(await getPayload("api/recording", { ...named(), ...clutter() }));
    } catch (error) {
      if (!isAborted(error)) showError(error);
    }
  }

  async function hangSound() {
    const { attachSound } = await import("./sound.js");
    if (node.isConnected) sound = attachSound(transport, clock, named);
  }

  function destroy() {
    job += 1;
    sound?.destroy();
    for (const end of endings) end();
    for (const panel of Object.values(panels)) panel.destroy?.();
    node.remove();
  }
}

function layout({ rangeTime, signature, scene, rangeDoppler, cadence, features }) {
  return element(
    "div",
    { class: "panels" },
    element("div", { class: "stack time-panels" }, rangeTime.node, signature.node),
    scene.node,
    rangeDoppler.node,
    cadence.node,
    features.node,
  );
}
