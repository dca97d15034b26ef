// The page of one run: a recording, a result, an example of a dataset, or what "Try it" has simulated.

import { makeAnnotations } from "./annotations.js";
import { getJson, getPayload, isAborted } from "./api.js";
import { makeCadence } from "./cadence.js";
import { makeClock } from "./clock.js";
import { makeCompare } from "./compare.js";
import { ANALYSIS, makeControls, STORED } from "./controls.js";
import { makeDetail } from "./detail.js";
import { makeEvidence } from "./evidence.js";
import { makeFeatures } from "./features.js";
import { listenToKeys } from "./keyboard.js";
import { drawCursor } from "./chart.js";
import { edges } from "./picture.js";
import { makeRangeDoppler } from "./range_doppler.js";
import { gateAt, gateColour, makeRangeTime } from "./range_time.js";
import { makeScene } from "./scene.js";
import { makeSignature } from "./signature.js";
import * as state from "./state.js";
import { makeNotes, makeStatus } from "./status.js";
import { savePicture, saveTable } from "./save.js";
import { makeTransport, restoreClock } from "./transport.js";
import { makeMeasure } from "./measure.js";
import { clearError, element, fixed, showError } from "./ui.js";
import { makeZoom } from "./zoom.js";

const NOT_LISTED = "#9aa3ab"; // colour of decisions about what the list of targets does not have

/**
 * Show a run in a container.
 *
 * `reference` holds the parameters that name it (see the server's run references). Gives `{update(reference), destroy()}`;
 * `update` takes another run into the same panels, which keep their old pictures until the new ones have come.
 */
export function showRun(container, reference, session) {
  const clock = makeClock();
  const zoom = makeZoom(clock);
  const compared = session.other && session.kind === "recording" && !reference.try;
  const before = compared ? `${session.name}: ` : ""; // with two recordings every panel names its own
  const page = { session, clock, zoom, tools: [], before, band: () => band(), widest: () => widest() };
  const measure = makeMeasure(page, drawTools);
  const annotations = makeAnnotations(page, drawTools);
  const panels = {
    rangeTime: makeRangeTime(page), signature: makeSignature(page), scene: makeScene(page),
    rangeDoppler: makeRangeDoppler(page), cadence: makeCadence(page), features: makeFeatures(page),
  };
  const decides = session.kind === "recording" && !reference.try && !compared;
  if (decides) panels.evidence = makeDecisions(page, () => decided, () => targets);
  const compare = compared ? makeCompare(page, showBoth) : null;
  const detail = makeDetail(page, panels, "own");
  const transport = makeTransport(clock);
  const controls = makeControls(session);
  const status = makeStatus();
  const facts = element("dl", { id: "facts", class: "facts", "aria-label": "The recording" });
  const notes = makeNotes();
  const line = element("div", { class: "notes-line" }, notes.node, status.node);
  const saving = [
    element("button", { id: "save-picture", type: "button", title: "The panels as a PNG file", onclick: () => savePicture(shownPanels, fileName(), title()) }, "save picture"),
    element("button", { id: "save-table", type: "button", title: "Features of all targets as a CSV file", onclick: () => saveTable(runs(), session, fileName()) }, "save table"),
  ];
  controls.node.append(measure.button, annotations.button, ...saving);
  const shownPanels = layout(panels, compare);
  const node = element("div", { class: "run" }, transport.node, controls.node, facts, line, shownPanels, annotations.node);
  let targets = { targets: [], arrays: {}, selected: 0 };
  let decided = null; // decisions up to now
  let overview = null; // signature of all ranges, until there are targets and where there are none
  let recorded = null; // facts of the recording
  let bands = []; // occupied part of the Doppler axis, by target
  let restored = false; // whether the time has been taken from the address
  let job = 0; // number of the newest load; answers to older ones are dropped
  let decisions = 0; // of the newest load, which other parameters of the analysis do not end
  let waiting = 0; // loads on their way
  const endings = [
    clock.subscribe(tick), state.subscribe(changed), listenToKeys(clock, moveTarget, actions()), controls.destroy, clock.destroy,
  ];
  let sound = null;
  container.replaceChildren(node);
  load();
  hangSound();
  return { update, destroy, clock };

  function update(next) {
    reference = next;
    state.set({ segment: null }, { quiet: true }); // one of another run
    return load();
  }

  async function load() {
    const mine = ++job;
    clearError();
    controls.clearFaults();
    recorded = overview = null;
    node.classList.remove("pictured");
    // the first pictures have the processor for themselves
    await busy(loadRecording(mine).then(() => mine === job && Promise.all([loadTargets(mine), compare?.load(named())])));
    if (mine !== job) return;
    if (decides) decide(++decisions);
    if (recorded?.duration_s === null) withoutRecording();
    sound?.refuse(silence());
    sound?.renew();
  }

  /** The page says what it waits for until all that is on its way has come. */
  async function busy(work) {
    node.classList.add("loading");
    if (!waiting++) status.begin(waitingFor);
    await work;
    if (--waiting) return;
    node.classList.remove("loading");
    status.end();
  }

  function waitingFor() {
    if (!recorded) return reference.try ? "simulating" : "reading";
    return recorded.duration_s === null ? "reading the result" : `analysing ${fixed(recorded.duration_s, 0)} s`;
  }

  async function loadRecording(mine) {
    try {
      const recording = await getPayload("api/recording", named());
      if (mine !== job) return;
      showRecording(recording);
      panels.rangeDoppler.load(named(), recording.facts.reason);
    } catch (error) {
      if (!isAborted(error) && !controls.fault(error.message)) showError(error);
    }
  }

  /** Why there is nothing to hear; null where there is. */
  function silence() {
    if (recorded?.no_sound) return recorded.no_sound;
    if (recorded?.duration_s === null) return "A result has no recording to listen to.";
    return targets.targets.some((target) => target.gate_limits) ? null : "There is no target with a gate to listen to.";
  }

  /** Results without their recording: the signature says how long they are. */
  function withoutRecording() {
    const signature = targets.targets[targets.selected]?.signature;
    if (signature) setTime(...edges(signature.x));
  }

  /** Parameters of the run, and of how it is analysed. */
  function named() {
    return { ...Object.fromEntries(["gate", ...ANALYSIS].map((name) => [name, state.get(name)])), ...reference };
  }

  async function loadTargets(mine) {
    try {
      const answer = await getPayload("api/targets", { ...named(), segment: state.get("segment") });
      if (mine !== job) return false;
      const refused = Boolean(
        answer.facts.failed && controls.fault(answer.facts.reason) && targets.targets.length > 0,
      );
      node.classList.toggle("outdated", refused);
      if (refused) return false;
      showTargets(answer);
      return true;
    } catch (error) {
      if (isAborted(error) || mine !== job) return false;
      if (controls.fault(error.message)) node.classList.toggle("outdated", targets.targets.length > 0);
      else {
        node.classList.remove("outdated");
        withoutTargets(error.message);
      }
      return false;
    }
  }

  /** Other parameters of the analysis: range against time and the scene stay as they are. */
  async function analyseAgain() {
    const mine = ++job;
    await busy(loadTargets(mine).then((done) => done && panels.rangeDoppler.load(named(), recorded?.reason)));
    if (mine !== job) return;
    sound?.renew();
    if (compare) await busy(compare.load(named()));
  }

  /** The second recording is there: time and Doppler of both. */
  function showBoth() {
    if (recorded?.duration_s) fitTime();
    redraw();
  }

  function fitTime() {
    const { start_s: start, duration_s: duration } = recorded;
    const [from, to] = compare?.times ?? [start, start];
    setTime(Math.min(start, from), Math.max(start + duration, to));
  }

  /** The decisions come in parts, while the rest of the recording is still being classified. */
  async function decide(mine) {
    decided = null;
    while (!decided?.complete) {
      try {
        const answer = await getJson("api/decisions", { gate: state.get("gate"), from: decided?.marks.length ?? 0 });
        if (mine !== decisions) return;
        decided = { ...answer, marks: [...(decided?.marks ?? []), ...answer.marks] };
      } catch (error) {
        if (!isAborted(error) && mine === decisions) showError(error);
        return;
      }
      panels.evidence.redraw();
    }
  }

  function showRecording(recording) {
    recorded = recording.facts;
    annotations.open(recorded);
    if (recorded.signature && !targets.targets.length) showOverview(recording);
    if (recorded.duration_s !== null) fitTime();
    showFacts(recording.facts);
    controls.fillGates(recording.facts);
    controls.fillAnalysis(recording.facts);
    panels.rangeTime.show(recording);
    panels.scene.show(recording);
    panels.signature.showTruth(recording);
    performance.mark("recording-shown");
  }

  function showOverview({ facts: { signature }, arrays }) {
    overview = { signature, overview: true, arrays };
    panels.signature.say(null);
    panels.signature.show(overview, arrays);
    panels.rangeTime.showTargets({ ...targets, overview });
    node.classList.add("pictured");
    refine();
  }

  function setTime(start, stop) {
    clock.setRange(start, stop, Math.min((stop - start) / 100, 0.02));
    if (!restored) restoreClock(clock);
    restored = true;
  }

  function showFacts({ facts: pairs, notes: sentences, reason }) {
    facts.replaceChildren(...pairs.map(([name, value]) => element("div", {}, element("dt", {}, name), element("dd", {}, value))));
    notes.show("recording", [reason, ...sentences].filter(Boolean));
  }

  function showTargets({ facts: { targets: found, reason, notes: said, analysis }, arrays }) {
    if (recorded) controls.fillAnalysis({ ...recorded, analysis });
    targets = { targets: found, arrays, selected: 0 };
    notes.show("analysis", said ?? []);
    if (!found.length) withoutTargets(reason ?? "No target was found.");
    else select();
    performance.mark("targets-shown");
  }

  function withoutTargets(reason) {
    targets = { targets: [], arrays: {}, selected: 0, overview };
    select();
    for (const panel of [panels.cadence, panels.features]) panel.say(reason);
    if (!overview) panels.signature.say(reason);
  }

  /** Show the target that the state names. */
  function select() {
    const wanted = state.getNumber("target", 0);
    targets.selected = targets.targets[wanted] ? wanted : 0;
    const target = targets.targets[targets.selected] ?? null;
    const { arrays } = targets;
    controls.fillTargets(targets.targets, targets.selected);
    controls.fillSegments(target);
    bands = targets.targets.map(({ signature }) => signature?.band_hz ?? null);
    const signed = target ?? overview;
    showOrSay(panels.signature, signed?.signature, "The signature of this target is not stored.", signed, target ? arrays : overview?.arrays);
    showOrSay(panels.cadence, target?.cadence_map, "The cadence-velocity diagram of this target is not stored.", target, arrays);
    showOrSay(panels.features, target, null, target, arrays);
    for (const panel of [panels.rangeTime, panels.rangeDoppler, panels.scene]) panel.showTargets(targets);
    panels.evidence?.redraw();
    refine();
  }

  /** What a zoom shows is computed again for its span; stored pictures are all there is of theirs. */
  function refine() {
    const target = targets.targets[targets.selected];
    const stored = !recorded?.duration_s || (STORED.includes(recorded.kind) && !state.get("gate"));
    detail.follow(stored ? null : { ...named(), target: target?.gate_limits ? targets.selected : null });
    compare?.refine(named());
  }

  function showOrSay(panel, there, reason, target, arrays) {
    panel.say(there ? null : reason);
    panel.show(there ? target : null, arrays);
  }

  function band() {
    const signature = (targets.targets[targets.selected] ?? overview)?.signature;
    if (state.get("band") === "all" && signature) return edges(signature.y);
    const known = [bands[targets.selected] ?? overview?.signature.band_hz, compare?.band].filter(Boolean);
    return known.length ? [Math.min(...known.map((one) => one[0])), Math.max(...known.map((one) => one[1]))] : null;
  }

  /** Band in which every target is seen. */
  function widest() {
    const known = state.get("band") === "all" ? [band()] : bands;
    const [lows, highs] = [0, 1].map((end) => known.filter(Boolean).map((one) => one[end]));
    return lows.length ? [Math.min(...lows), Math.max(...highs)] : null;
  }

  function actions() {
    const end = () => page.tools.forEach((tool) => tool.toggle(false));
    return { ...zoom.actions, m: () => measure.toggle(), n: () => annotations.toggle(), Escape: end };
  }

  /** Name of saved files: that of the recording without what a file name may not hold. */
  function fileName() {
    return (recorded?.name ?? "doppelgait").replace(/[^\w.-]+/g, "_");
  }

  /** Line above the saved picture: the recordings in it. */
  function title() {
    return runs().map(({ name }) => name).filter(Boolean).join(", ");
  }

  /** What the saved table holds. */
  function runs() {
    return [{ name: recorded?.name ?? "", targets: targets.targets }, ...(compare ? [compare] : [])];
  }

  function moveTarget(by) {
    const count = targets.targets.length;
    if (count) state.set({ target: (targets.selected + by + count) % count || null });
  }

  function tick() {
    zoom.follow();
    for (const panel of [panels.rangeTime, panels.signature, panels.scene, panels.rangeDoppler, panels.evidence]) panel?.tick();
    compare?.tick();
  }

  function drawTools() {
    tick();
    panels.cadence.tick();
  }

  function redraw() {
    for (const panel of [panels.rangeTime, panels.signature, panels.rangeDoppler, panels.cadence, panels.evidence]) panel?.redraw();
    compare?.redraw();
  }

  function changed(names) {
    if (names.has("gate") || names.has("clutter")) {
      if (!names.has("segment")) state.set({ segment: null }, { quiet: true }); // there may be others now
      load();
    } else if (ANALYSIS.some((name) => names.has(name))) analyseAgain();
    else if (names.has("segment")) busy(loadTargets(job));
    else if (names.has("target")) select();
    if (["map", "lo", "hi", "band", "time", "doppler", "lines"].some((name) => names.has(name))) redraw();
    if (names.has("time")) refine();
    if (names.has("t")) clock.seek(state.getNumber("t", clock.start));
  }

  async function hangSound() {
    const { attachSound } = await import("./sound.js");
    if (!node.isConnected) return;
    sound = attachSound(transport, clock, named);
    if (!waiting) sound.refuse(silence());
  }

  function destroy() {
    job += 1;
    decisions += 1;
    status.end();
    sound?.destroy();
    detail.destroy();
    for (const end of endings) end();
    for (const panel of Object.values(panels)) panel.destroy?.();
    compare?.destroy();
    node.remove();
  }
}

/** Panel of the decisions, below the signature and on its time axis; its tracks are named by the targets of the list. */
function makeDecisions(page, facts, listed) {
  const { clock, zoom } = page;
  const time = () => ({ limits: zoom.time.limits([clock.start, clock.stop]), name: "time", unit: "s" });
  const evidence = makeEvidence({
    facts, time, subject, drag: clock.seek, zoom: { x: zoom.time }, page,
    drawOver: (context) => drawCursor(context, evidence.chart, clock.time),
  });
  return evidence;

  function subject(marks) {
    const number = followed(marks, listed());
    if (number === null) return { name: "track that is not listed", words: "–", colour: NOT_LISTED };
    return { name: `target ${number}`, words: String(number), colour: gateColour(number) };
  }
}

/** Number of the target in whose gate a track of the decisions is most often, and nearest to its middle; null for none. */
function followed(marks, { targets, arrays }) {
  const scores = targets.map((target) => marks.reduce((sum, { time_s: time, range_m: range }) => {
    const [low, high] = gateAt(target, arrays, time) ?? [0, 0];
    return sum + Math.max(1 - Math.abs(2 * range - low - high) / (high - low), 0);
  }, 0));
  const best = scores.indexOf(Math.max(...scores, 1e-9));
  return best < 0 ? null : best;
}

function layout({ rangeTime, signature, evidence, scene, rangeDoppler, cadence, features }, compare) {
  return element(
    "div",
    { class: "panels" },
    element("div", { class: "row" }, element("div", { class: "stack time-panels" }, rangeTime.node, signature.node, evidence?.node, compare?.stacked), scene.node),
    element("div", { class: "row" }, rangeDoppler.node, cadence.node, features.node, compare?.features),
  );
}
