// Levels of 16 bits as coloured pixels, and back to numbers.

/** Colour table of 256 entries from the text "RRGGBB" * 256, as the pixels of an ImageData. */
export function colourTable(text) {
  const table = new Uint32Array(256);
  const bytes = new Uint8Array(table.buffer);
  for (let entry = 0; entry < 256; entry += 1) {
    for (let channel = 0; channel < 3; channel += 1) {
      const at = 6 * entry + 2 * channel;
      bytes[4 * entry + channel] = Number.parseInt(text.slice(at, at + 2), 16);
    }
    bytes[4 * entry + 3] = 255;
  }
  return table;
}

/** Pixel of each of the 65536 codes: levels from `limits[0]` to `limits[1]` dB take the table from end to end. */
export function tones(db, limits, table) {
  const step = (db[1] - db[0]) / 65535;
  const scale = 256 / Math.max(limits[1] - limits[0], 1e-9);
  const pixels = new Uint32Array(65536);
  for (let code = 0; code < 65536; code += 1) {
    const entry = Math.floor((db[0] + code * step - limits[0]) * scale);
    pixels[code] = table[Math.min(Math.max(entry, 0), 255)];
  }
  return pixels;
}

/** Paint codes of shape (columns, rows) on a canvas of that size, the first row at the bottom. */
export function paint(canvas, codes, [columns, rows], pixels) {
  if (canvas.width !== columns || canvas.height !== rows) Object.assign(canvas, { width: columns, height: rows });
  const context = canvas.getContext("2d");
  const image = context.createImageData(columns, rows);
  const target = new Uint32Array(image.data.buffer);
  for (let column = 0; column < columns; column += 1) {
    const from = column * rows;
    let to = (rows - 1) * columns + column;
    for (let row = 0; row < rows; row += 1, to -= columns) target[to] = pixels[codes[from + row]];
  }
  context.putImageData(image, 0, 0);
}

/** Level in dB of one cell. */
export function levelDb(image, codes, column, row) {
  return image.db[0] + (codes[column * image.y.n + row] * (image.db[1] - image.db[0])) / 65535;
}

/** Number of the cell of an axis at a value; null beside it. */
export function cellAt(axis, value) {
  if (axis.n === 1) return 0;
  const cell = Math.round((value - axis.first) / axis.step);
  return cell >= 0 && cell < axis.n ? cell : null;
}

export function valueAt(axis, cell) {
  return axis.first + cell * axis.step;
}

/** Outer edges of the cells of an axis; one single cell is drawn one unit wide. */
export function edges(axis) {
  const step = axis.step || 1;
  return [axis.first - step / 2, axis.first + (axis.n - 0.5) * step];
}
