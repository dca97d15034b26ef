// Requests to the server of this page: JSON, and payloads of named binary arrays (see payload.py).

const root = new URL("../", import.meta.url); // the folder with the token; modules lie in static/ below it
const kinds = {
  uint8: Uint8Array, uint16: Uint16Array, uint32: Uint32Array, int16: Int16Array, int32: Int32Array,
  float32: Float32Array, float64: Float64Array,
};
const running = new Map();

/** Address below the token; empty values are left out, lists are repeated. */
export function address(path, params = {}) {
  const url = new URL(path, root);
  for (const [name, value] of Object.entries(params)) {
    for (const one of Array.isArray(value) ? value : [value]) {
      if (one !== null && one !== undefined && one !== "") url.searchParams.append(name, one);
    }
  }
  return url;
}

/** True for the error of a request that a newer one of the same key has ended. */
export function isAborted(error) {
  return error?.name === "AbortError";
}

export async function getJson(path, params, options) {
  return request(path, params, options, (response) => response.json());
}

/** `{facts, arrays}`: the header of a payload, and its arrays as typed arrays with a `shape`. */
export async function getPayload(path, params, options) {
  return parsePayload(await request(path, params, options, (response) => response.arrayBuffer()));
}

export async function getBlob(path, params, options) {
  return request(path, params, options, (response) => response.blob());
}

/** One request; an older one with the same key is aborted (`key: null`: none is). */
async function request(path, params, { key = path } = {}, read) {
  const control = new AbortController();
  if (key !== null) {
    running.get(key)?.abort();
    running.set(key, control);
  }
  try {
    const response = await fetch(address(path, params), { signal: control.signal });
    if (!response.ok) throw new Error(await reasonOf(response));
    return await read(response);
  } catch (error) {
    if (error instanceof TypeError) throw new Error("The viewer's server does not answer; is the command still running?");
    throw error;
  } finally {
    if (running.get(key) === control) running.delete(key);
  }
}

async function reasonOf(response) {
  const text = await response.text();
  try {
    return JSON.parse(text).error ?? text;
  } catch {
    return `The server answered ${response.status} ${response.statusText}`;
  }
}

/** A payload taken apart; the arrays are views of its bytes, not copies. */
export function parsePayload(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 8 || new TextDecoder().decode(new Uint8Array(buffer, 0, 4)) !== "DGV1") {
    throw new Error("The server's answer is no payload of this viewer; reload the page");
  }
  const length = view.getUint32(4, true);
  const facts = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  const arrays = {};
  for (const [name, { dtype, shape, offset }] of Object.entries(facts.arrays)) {
    const count = shape.reduce((product, size) => product * size, 1);
    arrays[name] = new kinds[dtype](buffer, 8 + length + offset, count);
    arrays[name].shape = shape;
  }
  return { facts, arrays };
}
