// Annotations: spans of time with a label, kept in this browser by the content of the recording, and saved as JSON or CSV.

import { FONT } from "./axes.js";
import { makeTool } from "./measure.js";
import { csvOf, download } from "./save.js";
import { element, fixed } from "./ui.js";

const COLOUR = "#9cff57";
const TITLE = "Mark a span of time in a picture with a time axis: two clicks, or a drag (n; Esc ends)";

/** `node` is the list of the annotations and `button` marks another; `open(facts)` takes those of a recording. */
export function makeAnnotations(page, changed) {
  const tool = makeTool(page, "annotate", TITLE, { paint, taken, fits, changed });
  const rows = element("tbody");
  const save = (id, write) => element("button", { type: "button", id: `annotations-${id}`, onclick: write }, `save ${id.toUpperCase()}`);
  const buttons = [
    save("csv", () => keepFile("csv", csvOf([["start_s", "stop_s", "label", "file"], ...list.map(Object.values)]))),
    save("json", () => keepFile("json", `${JSON.stringify(list, null, 2)}\n`)),
  ];
  const heads = ["from (s)", "to (s)", "label", ""].map((words) => element("th", { scope: "col" }, words));
  const table = element("table", {}, element("thead", {}, element("tr", {}, heads)), rows);
  const node = element(
    "section",
    { id: "annotations", class: "panel annotations", "aria-label": "Annotations", hidden: true },
    element("header", {}, element("strong", {}, "Annotations"), element("div", { class: "tools" }, buttons)),
    table,
  );
  const drawn = { on: false, toggle: () => {}, draw: (context, chart) => list.forEach((one) => drawSpan(context, chart, one)) };
  let list = []; // {start_s, stop_s, label, file}
  let [file, key] = [null, null]; // name of the recording, and that of its annotations in the browser
  page.tools.push(drawn); // what has been marked is seen whether or not the tool is on
  return { node, button: tool.button, toggle: tool.toggle, open };

  /** A second recording has times of its own. */
  function fits(chart) {
    return chart.view?.x.unit === "s" && !chart.canvas.closest('[id^="panel-other-"]');
  }

  function open({ name, content }) {
    [file, key] = [name, `doppelgait annotations ${content}`]; // two files may have one name
    let kept = null;
    try {
      kept = JSON.parse(localStorage.getItem(key));
    } catch {
      // a browser that keeps nothing, or what another program has written there
    }
    list = (Array.isArray(kept) ? kept : []).filter((one) => Number.isFinite(one?.start_s) && Number.isFinite(one.stop_s));
    list = list.map(({ start_s, stop_s, label }) => ({ start_s, stop_s, label: String(label ?? ""), file }));
    show();
  }

  function keep() {
    list.sort((a, b) => a.start_s - b.start_s);
    try {
      localStorage.setItem(key, JSON.stringify(list));
    } catch {
      // they last until the page is closed
    }
    show();
  }

  function taken(...points) {
    const [start, stop] = points.map(([x]) => Number(x.toFixed(3))).sort((a, b) => a - b);
    const one = { start_s: start, stop_s: stop, label: "", file };
    tool.toggle(false);
    if (start === stop) return;
    list.push(one);
    keep();
    setTimeout(() => rows.children[list.indexOf(one)]?.querySelector("input").focus()); // after the press, which takes the focus
  }

  function show() {
    node.hidden = !list.length;
    rows.replaceChildren(...list.map(row));
    changed();
  }

  function row(one) {
    const label = element("input", {
      type: "text", value: one.label, placeholder: "label", "aria-label": "Label",
      onchange: () => { one.label = label.value.trim(); keep(); },
    });
    const forget = () => { list = list.filter((other) => other !== one); keep(); };
    const cells = [fixed(one.start_s, 3), fixed(one.stop_s, 3), label, element("button", { type: "button", onclick: forget }, "delete")];
    return element("tr", {}, cells.map((cell) => element("td", {}, cell)));
  }

  function keepFile(ending, text) {
    download(new Blob([text], { type: ending === "csv" ? "text/csv" : "application/json" }), `${file}.annotations.${ending}`);
  }

  function paint(context, chart, [from], [to]) {
    drawSpan(context, chart, { start_s: Math.min(from, to), stop_s: Math.max(from, to), label: "" });
  }

  function drawSpan(context, chart, { start_s: start, stop_s: stop, label }) {
    if (!fits(chart)) return;
    const { top, bottom } = chart.box;
    const [from, to] = [start, stop].map(chart.x);
    context.fillStyle = COLOUR;
    context.globalAlpha = 0.18;
    context.fillRect(from, top, to - from, bottom - top);
    context.globalAlpha = 1;
    for (const at of [from, to]) context.fillRect(at - 0.5, top, 1, bottom - top);
    context.font = FONT;
    context.textAlign = "left";
    context.textBaseline = "bottom";
    context.fillText(label, Math.max(from, chart.box.left) + 4, bottom - 3);
  }
}
