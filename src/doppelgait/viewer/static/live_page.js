// The page of a stream: the last half minute of range, Doppler, tracks and decisions, asked for twice a second.

import { getPayload, isAborted } from "./api.js";
import { drawLine, makeChart, withEdge } from "./chart.js";
import { byTrack, drawDots, makeEvidence } from "./evidence.js";
import { makeLevels } from "./levels.js";
import { edges } from "./picture.js";
import { gateColour } from "./range_time.js";
import { clearError, dot, element, fixed, makePanel, showError } from "./ui.js";

const EVERY_MS = 500;
const LOSSES = {
  filled: "filled", malformed: "malformed", late: "late", jumps: "jumps", skipped: "hops skipped", failed: "windows failed",
};

export function show(container, session) {
  const page = { session, facts: null, arrays: {} };
  const status = element("p", { id: "live-status", class: "live-status", "aria-live": "polite" });
  const tracks = element("table", { id: "live-tracks", class: "live-tracks", "aria-label": "Tracks" });
  const charts = [
    makeMap(page, "range_time", "range-time", "Range against time", "range", 2, drawTracks),
    makeMap(page, "signature", "signature", "Micro-Doppler signature of the tracked targets", "Doppler", 0, () => {}),
    makeEvidence({ id: "live-evidence", facts: () => page.facts, time: () => timeAxis(page.facts) }),
  ];
  container.replaceChildren(element("div", { class: "live" }, status, tracks, ...charts.map((chart) => chart.node)));
  let timer = null;
  let ended = false;
  ask();
  return { destroy };

  async function ask() {
    try {
      const { facts, arrays } = await getPayload("api/live");
      if (ended) return;
      Object.assign(page, { facts, arrays });
      clearError();
      status.replaceChildren(...statusOf(facts));
      fillTracks(tracks, facts);
      for (const chart of charts) chart.redraw();
      if (facts.state === "ended") return; // nothing will change
    } catch (error) {
      if (isAborted(error) || ended) return;
      showError(error);
    }
    timer = setTimeout(ask, EVERY_MS);
  }

  function destroy() {
    ended = true;
    clearTimeout(timer);
    for (const chart of charts) chart.destroy();
  }
}

function statusOf(facts) {
  const { counts, state } = facts;
  const words = [`${facts.source} · ${facts.radar}`];
  if (state === "ended") words.push(facts.reason);
  else if (state === "waiting") words.push("no window yet");
  if (facts.stop_s !== null) words.push(`${fixed(facts.stop_s, 1)} s`);
  if (counts.frames !== undefined) words.push(`${counts.frames} frames`, `${counts.windows} windows`);
  for (const [name, said] of Object.entries(LOSSES)) if (counts[name]) words.push(`${counts[name]} ${said}`);
  if (facts.processor_share !== undefined) words.push(`${fixed(facts.processor_share, 2)} s of processor per s of radar`);
  return [element("strong", { class: `state-${state}` }, state), ` ${words.join(" · ")}`];
}

/** The tracks of the newest window. */
function newest(facts) {
  return facts.marks.filter((mark) => Math.abs(mark.time_s - facts.stop_s) < 1e-6);
}

function fillTracks(table, facts) {
  const heads = ["track", "decision", "probability", "alarm", "range (m)", "approach (m/s)", "why no decision"];
  const alarm = { true: "yes", false: "no", null: "–" };
  const rows = newest(facts).map((mark) => {
    const cells = [
      [dot(gateColour(mark.track)), String(mark.track)], mark.label ?? "none", fixed(mark.probability, 2), alarm[String(mark.alarm)],
      fixed(mark.range_m, 2), fixed(mark.approach_mps, 2), mark.label === null ? mark.reason : "",
    ];
    return element("tr", { class: mark.alarm ? "alarm" : null }, cells.map((cell) => element("td", {}, cell)));
  });
  if (!rows.length) rows.push(element("tr", {}, element("td", { colspan: heads.length }, "no target in the newest window")));
  table.replaceChildren(
    element("thead", {}, element("tr", {}, ...heads.map((head) => element("th", { scope: "col" }, head)))),
    element("tbody", {}, ...rows),
  );
}

function timeAxis(facts) {
  return { limits: [facts.start_s, facts.stop_s], name: "time", unit: "s" };
}

/** Rolling picture of levels against time. */
function makeMap(page, field, name, title, quantity, decimals, drawMarks) {
  const panel = makePanel(name, title);
  const levels = makeLevels(panel, page.session, () => chart.redraw());
  const chart = makeChart(panel, `live-${name}`, {
    label: title,
    view,
    draw(context) {
      levels.draw(context, chart);
      drawMarks(context, chart, page.facts);
    },
    read(time, value) {
      const at = `${fixed(time, 2)} s · ${fixed(value, decimals)} ${page.facts[field].y.unit}`;
      return [at, levels.at(time, value)?.level].filter(Boolean).join(" · ");
    },
  });
  return { node: panel.node, redraw, destroy: chart.destroy };

  function view() {
    const image = page.facts?.[field];
    if (!image) return null;
    const limits = image.band_hz ?? edges(image.y);
    return { x: timeAxis(page.facts), y: { limits, name: quantity, unit: image.y.unit }, second: image.y.second };
  }

  function redraw() {
    const image = page.facts?.[field] ?? null;
    panel.say(image ? null : field === "signature" ? "No target so far." : "No window so far.");
    levels.show(image, image && page.arrays[image.array]);
  }
}

function drawTracks(context, chart, facts) {
  for (const [track, marks] of byTrack(facts)) {
    withEdge(context, gateColour(track), 1.8, () => drawLine(context, chart, marks.length, (n) => [marks[n].time_s, marks[n].range_m]));
    drawDots(context, chart, marks, "range_m", gateColour(track));
  }
}
