// The page of a stream: the last half minute of range, Doppler, tracks and decisions, asked for twice a second.

import { getPayload, isAborted } from "./api.js";
import { drawLine, drawPicture, makeChart, withEdge } from "./chart.js";
import { makeBar, makeTones } from "./levels.js";
import { cellAt, edges, levelDb, occupied, paint } from "./picture.js";
import { gateColour } from "./range_time.js";
import { clearError, element, fixed, makePanel, showError } from "./ui.js";

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
    makeEvidence(page),
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
  const rows = newest(facts).map((mark) =>
    element(
      "tr",
      { class: mark.alarm ? "alarm" : null },
      element("td", {}, element("span", { class: "dot", style: null }), String(mark.track)),
      element("td", {}, mark.label ?? "none"),
      element("td", {}, fixed(mark.probability, 2)),
      element("td", {}, alarm[String(mark.alarm)]),
      element("td", {}, fixed(mark.range_m, 2)),
      element("td", {}, fixed(mark.approach_mps, 2)),
      element("td", {}, mark.label === null ? mark.reason : ""),
    ),
  );
  for (const [number, row] of rows.entries()) row.querySelector(".dot").style.background = gateColour(newest(facts)[number].track);
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
  const picture = element("canvas");
  const bar = makeBar(panel.tools, page.session);
  const tonesOf = makeTones(page.session);
  const chart = makeChart(panel, `live-${name}`, {
    label: title,
    view,
    draw(context) {
      const image = page.facts[field];
      drawPicture(context, chart, picture, image);
      drawMarks(context, chart, page.facts);
    },
    read(time, value) {
      const image = page.facts[field];
      const [column, row] = [cellAt(image.x, time), cellAt(image.y, value)];
      const at = `${fixed(time, 2)} s · ${fixed(value, decimals)} ${image.y.unit}`;
      return column === null || row === null ? at : `${at} · ${fixed(levelDb(image, page.arrays[image.array], column, row), 1)} ${image.unit}`;
    },
  });
  return { node: panel.node, redraw, destroy: chart.destroy };

  function view() {
    const image = page.facts?.[field];
    if (!image) return null;
    const limits = image.y.second ? occupied(image, page.arrays[image.array]) : edges(image.y);
    return { x: timeAxis(page.facts), y: { limits, name: quantity, unit: image.y.unit }, second: image.y.second };
  }

  function redraw() {
    const image = page.facts?.[field] ?? null;
    panel.say(image ? null : field === "signature" ? "No target so far." : "No window so far.");
    bar(image);
    if (image) paint(picture, page.arrays[image.array], [image.x.n, image.y.n], tonesOf(image));
    chart.redraw();
  }
}

function byTrack(facts) {
  const found = new Map();
  for (const mark of facts.marks) found.set(mark.track, [...(found.get(mark.track) ?? []), mark]);
  return found;
}

function drawTracks(context, chart, facts) {
  for (const [track, marks] of byTrack(facts)) {
    withEdge(context, gateColour(track), 1.8, () => drawLine(context, chart, marks.length, (n) => [marks[n].time_s, marks[n].range_m]));
    dots(context, chart, marks, "range_m", gateColour(track));
  }
}

function dots(context, chart, marks, field, colour) {
  context.fillStyle = colour;
  for (const mark of marks) {
    if (!Number.isFinite(mark[field])) continue;
    context.beginPath();
    context.arc(chart.x(mark.time_s), chart.y(mark[field]), 3, 0, 2 * Math.PI);
    context.fill();
  }
}

/** Probability of the alarm's class by track, and the threshold. */
function makeEvidence(page) {
  const panel = makePanel("evidence", "Probability of the alarm's class, fused");
  const chart = makeChart(panel, "live-evidence", {
    label: "Probability of the alarm's class against time, by track",
    view: () =>
      page.facts?.stop_s == null || page.facts.alarm_class === null
        ? null
        : { x: timeAxis(page.facts), y: { limits: [-0.03, 1.03], name: "probability", unit: page.facts.alarm_class } },
    draw(context) {
      const { facts } = page;
      context.fillStyle = "#15181c";
      context.fillRect(chart.box.left, chart.box.top, chart.box.right - chart.box.left, chart.box.bottom - chart.box.top);
      if (facts.alarm_threshold !== null) {
        context.setLineDash([6, 4]);
        withEdge(context, "#ff5a4d", 1.4, () => {
          drawLine(context, chart, 2, (n) => [n ? facts.stop_s : facts.start_s, facts.alarm_threshold]);
        });
        context.setLineDash([]);
        context.fillStyle = "#ff8a80";
        context.font = "11px system-ui, sans-serif";
        context.fillText(`alarm from ${fixed(facts.alarm_threshold, 2)}`, chart.box.left + 6, chart.y(facts.alarm_threshold) - 4);
      }
      for (const [track, marks] of byTrack(facts)) {
        withEdge(context, gateColour(track), 1.8, () => drawLine(context, chart, marks.length, (n) => [marks[n].time_s, marks[n].evidence]));
        dots(context, chart, marks, "evidence", gateColour(track));
      }
    },
    read: (time, value) => `${fixed(time, 2)} s · ${fixed(value, 2)}`,
  });
  return { node: panel.node, redraw, destroy: chart.destroy };

  function redraw() {
    const missing = page.facts?.alarm_class === null;
    panel.say(missing ? "The model has no alarm." : page.facts?.stop_s == null ? "No window so far." : null);
    chart.redraw();
  }
}
