// Contact sheet of the dataset browser: small signatures with common axes and levels; a click opens the example.

import { table as colourTable } from "./levels.js";
import { paint } from "./picture.js";
import { dot, element, fixed, significant } from "./ui.js";

export const SHEET_PAGE = 24;

/** Sheet in `container`; `draw(payload)` shows a page, `recolour()` follows another colour map. */
export function makeSheet(container, session, { onOpen }) {
  const grid = element("div", { id: "sheet", class: "sheet" });
  const note = element("p", { class: "faint sheet-note" });
  container.append(note, grid);
  let pictures = [];
  return { draw, recolour };

  function draw({ facts, arrays }) {
    const { image } = facts;
    const [columns, rows] = image ? [image.x.n, image.y.n] : [1, 1];
    const size = columns * rows;
    pictures = [];
    const cards = facts.ids.map((id, n) => {
      const reason = facts.reasons[n];
      const codes = reason || !image ? null : arrays[image.array].subarray(n * size, (n + 1) * size);
      return card({ id, label: facts.labels[n], caption: facts.captions[n], reason }, facts.offset + n, codes, [columns, rows]);
    });
    grid.replaceChildren(...cards);
    note.textContent = image ? axesText(image) : cards.length ? "" : "No row matches these filters.";
    recolour();
  }

  function card({ id, label, caption, reason }, place, codes, shape) {
    const canvas = codes ? element("canvas", { role: "img", "aria-label": `Signature of ${id}` }) : null;
    if (canvas) pictures.push({ canvas, codes, shape });
    const colour = session.class_colours[label];
    return element(
      "button", { type: "button", class: "card", "data-id": id, title: id, onclick: () => onOpen(id, place) },
      canvas ?? element("span", { class: "missing" }, reason ?? "not shown"),
      element("span", { class: "card-id" }, colour ? dot(colour) : null, id),
      element("small", {}, caption),
    );
  }

  function recolour() {
    const table = colourTable(session);
    for (const { canvas, codes, shape } of pictures) paint(canvas, codes, shape, table);
  }
}

function axesText(image) {
  const [x, y] = [image.x, image.y].map((axis) => [axis.first - axis.step / 2, axis.first + (axis.n - 0.5) * axis.step]);
  const levels = `${fixed(image.db[0], 0)} to ${fixed(image.db[1], 0)} ${image.unit}`;
  const across = `across ${significant(x[1] - x[0])} s`;
  return `All ${across}, up ${significant(y[0])} to ${significant(y[1])} ${image.y.unit} (approaching up), ${levels}.`;
}
