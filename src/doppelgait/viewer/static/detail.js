// The part of the time that is shown, on a finer grid than the pictures of the whole recording have.

import { getPayload, isAborted } from "./api.js";
import { showError } from "./ui.js";

const PAUSE_MS = 150; // after which a zoom or a scroll has come to rest

/** `follow(params)` asks for the detail of what the zoom shows, or takes it back; `panels` have `refine(image, codes)`. */
export function makeDetail({ clock, zoom }, { rangeTime, signature }, name) {
  let timer = null;
  return { follow, destroy: () => clearTimeout(timer) };

  /** `params` name the run and its target; null where there is nothing to compute. */
  function follow(params) {
    clearTimeout(timer);
    timer = setTimeout(() => refine(params), PAUSE_MS);
  }

  async function refine(params) {
    const [from, to] = zoom.time.shown;
    if (!params || to - from > 0.7 * (clock.stop - clock.start)) return put({}, {});
    try {
      const { facts, arrays } = await getPayload("api/detail", { ...params, from, to }, { key: `detail ${name}` });
      put(facts, arrays);
    } catch (error) {
      if (!isAborted(error)) showError(error);
    }
  }

  function put(facts, arrays) {
    rangeTime.refine(facts.range_time, arrays.range_time);
    signature.refine(facts.signature, arrays.signature);
  }
}
