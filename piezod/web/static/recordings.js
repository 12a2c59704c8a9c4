/** The recordings of a stage. */

import { el } from "./dom.js";

/** Show the recordings in an element; return a function that ends it. */
export async function mount(element, context) {
  const { recordings } = await context.call("GET", "/v1/recordings");
  element.replaceChildren(
    el("h1", {}, `Recordings of ${context.stage().stage}`),
    el("ul", {}, recordings.map((each) => el("li", {}, each.name ?? String(each)))),
  );
  return () => {};
}
