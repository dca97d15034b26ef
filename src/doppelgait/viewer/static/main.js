// Start of the page: what the server holds, as tabs.

import { getJson } from "./api.js";
import { refreshTheme } from "./canvas.js";
import { makeHelp } from "./keyboard.js";
import * as state from "./state.js";
import { clearError, element, showError } from "./ui.js";

const TABS = {
  recording: { words: "Recording", show: showRecording },
  dataset: { words: "Dataset", show: async (...args) => (await import("./dataset_page.js")).show(...args) },
  live: { words: "Live", show: async (...args) => (await import("./live_page.js")).show(...args) },
  try: { words: "Try it", show: async (...args) => (await import("./try_page.js")).show(...args) },
};
/** Choices that mean something else, or nothing, in another tab. */
const OF_ONE_RUN = ["gate", "target", "segment", "clutter", "cpi_s", "window_steepness", "hop", "time", "doppler", "t"];
let shown = null; // {name, page} of the open tab
let opening = 0;

async function showRecording(container, session) {
  const { showRun } = await import("./run_page.js");
  return showRun(container, {}, session);
}

/** Tabs that this session has: what was opened, and "Try it". */
function tabsOf(session) {
  if (session.kind === "live") return ["live"]; // what "Try it" simulates would take the processor from the stream
  const opened = { recording: "recording", result: "recording", dataset: "dataset" }[session.kind];
  return [opened, "try"].filter(Boolean);
}

async function openTab(session, names) {
  const wanted = state.get("tab");
  const name = names.includes(wanted) ? wanted : names[0];
  for (const tab of document.querySelectorAll("#tabs button")) tab.setAttribute("aria-selected", String(tab.dataset.tab === name));
  if (shown?.name === name) return;
  const mine = ++opening;
  shown?.page?.destroy?.();
  clearError();
  const container = element("div"); // each tab its own: one that is still loading does not empty the next
  document.getElementById("page").replaceChildren(container);
  shown = { name, page: null };
  try {
    const page = await TABS[name].show(container, session);
    if (mine === opening) shown.page = page;
    else page?.destroy?.();
  } catch (error) {
    showError(error);
  }
}

function makeTabs(session, names) {
  const make = (name) =>
    element(
      "button",
      { id: `tab-${name}`, type: "button", role: "tab", "data-tab": name, onclick: () => change(name, names) },
      TABS[name].words,
    );
  document.getElementById("tabs").replaceChildren(...names.map(make));
}

function change(name, names) {
  if (name === shown?.name) return;
  const dropped = Object.fromEntries(OF_ONE_RUN.map((key) => [key, null]));
  state.set({ ...dropped, tab: name === names[0] ? null : name }, { push: true });
}

function followTheme() {
  const select = document.getElementById("theme");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const apply = () => {
    const chosen = state.get("theme", "");
    select.value = ["light", "dark"].includes(chosen) ? chosen : "";
    document.documentElement.dataset.theme = select.value || (dark.matches ? "dark" : "light");
    refreshTheme();
  };
  select.onchange = () => state.set({ theme: select.value });
  state.subscribe((names) => names.has("theme") && apply());
  dark.addEventListener("change", apply);
  apply();
}

async function start() {
  followTheme();
  makeHelp(document.getElementById("help-dialog"), document.getElementById("help"));
  const session = await getJson("api/session");
  document.getElementById("name").textContent = session.path_name ?? "";
  document.title = `${session.path_name || session.name || "viewer"} · doppelgait`;
  const names = tabsOf(session);
  makeTabs(session, names);
  state.subscribe((changed) => changed.has("tab") && openTab(session, names));
  await openTab(session, names);
}

start().catch((error) => {
  document.getElementById("page").replaceChildren();
  showError(error);
});
