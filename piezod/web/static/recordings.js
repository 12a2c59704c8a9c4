/** The recordings of a stage: their list, or the one that the address names. */

import { mountList } from "./recording_list.js";
import { mountView } from "./recording_view.js";

/** Show the recordings in an element; return a function that ends it. */
export function mount(element, context) {
  return context.file() ? mountView(element, context) : mountList(element, context);
}
