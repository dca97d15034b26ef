// Where an example stands in the list that the address means, and which rows are before and behind it.

import { getJson } from "./api.js";
import { listed } from "./asked.js";

const CHUNK = 500; // rows of one request; the server gives no more
const MOST = 20; // requests for one example

/**
 * `{place, previous, next}` of an example; ids are undefined at the ends, all of them where it is not in the list.
 * `guess` is the place where it was last seen; without a right one the list is searched from its start.
 */
export async function neighboursOf(id, guess) {
  if (Number.isInteger(guess) && guess >= 0) {
    const found = await within(id, Math.max(guess - 1, 0), 3);
    if (found.place === guess) return found;
  }
  for (let n = 0, end = 1; n < MOST && n * CHUNK < end; n += 1) {
    const found = await within(id, n * CHUNK, CHUNK);
    if (found.place !== undefined) return around(id, found);
    end = found.end;
  }
  return {};
}

/** Look for an example in a section of the list. */
async function within(id, offset, limit) {
  const answer = await getJson("api/rows", { ...listed(), offset, limit }, { key: "neighbours" });
  const ids = answer.rows.map((row) => row.id);
  const n = ids.indexOf(id);
  const found = { end: answer.n_matching };
  return n < 0 ? found : { ...found, place: offset + n, previous: ids[n - 1], next: ids[n + 1] };
}

/** At the edge of a chunk one of the neighbours lies in the next one. */
function around(id, found) {
  const lacks = (found.previous === undefined && found.place > 0) || (found.next === undefined && found.place + 1 < found.end);
  return lacks ? within(id, found.place - 1, 3) : found;
}
