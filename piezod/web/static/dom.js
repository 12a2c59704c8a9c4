/** Elements of the document from script. A style attribute is never set: the policy refuses it. */

/**
 * Return a new element.
 *
 * @param {string} tag Name of the element.
 * @param {object} attributes Attributes. A function under `onclick` and the like is a listener; true
 *   is an attribute without a value; false, null and undefined leave the attribute out.
 * @param {...(Node|string|null)} children Nodes and texts; null is left out.
 */
export function el(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value != null) element.setAttribute(name, value);
  }
  element.append(...children.flat(Infinity).filter((child) => child != null));
  return element;
}

/** Return a new SVG element with attributes. */
export function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** Set the text of an element if it is another one; a change of nothing costs a layout too. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Return a text as nodes: what stands between back quotes is code, as in `piezod status`. */
export function withCode(text) {
  return text.split("`").map((part, index) => (index % 2 ? el("code", {}, part) : part)).filter((part) => part !== "");
}

let numbers = 0;

/** Return an id that no other element has, for labels and descriptions. */
export function newId(prefix) {
  numbers += 1;
  return `${prefix}-${numbers}`;
}

/** Return a labelled field: a `label` around a caption, a control and its unit. */
export function field(caption, control, unit = "") {
  return el(
    "label", { class: "field" },
    el("span", { class: "caption" }, caption),
    el("span", { class: "with-unit" }, control, unit ? el("span", { class: "unit" }, unit) : null),
  );
}
