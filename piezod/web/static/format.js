/** Numbers with units, and times, as people read them. A number keeps its width as it changes. */

const MINUS = "\u2212";
export const UNKNOWN = "–";

/** Return a number with a fixed number of decimals, or a dash if it is not known. */
export function fixed(value, decimals) {
  if (value == null || Number.isNaN(value)) return UNKNOWN;
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** Return a number with three significant digits and no exponent where it can be read without. */
export function short(value) {
  if (value == null || Number.isNaN(value)) return UNKNOWN;
  if (value !== 0 && (Math.abs(value) < 1e-4 || Math.abs(value) >= 1e6)) return value.toExponential(2).replace("-", MINUS);
  return String(Number(value.toPrecision(3))).replace("-", MINUS);
}

export const microns = (value) => fixed(value, 3);
export const volts = (value) => fixed(value, 2);

/** Return a text that begins with a capital. */
export const capital = (text) => text[0].toUpperCase() + text.slice(1);

/** Return a value as the description of its field says: a number with its unit, yes or no, or words. */
export function described(value, { unit, digits }) {
  if (value == null || value === "") return UNKNOWN;
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (Array.isArray(value)) return value.join(", ") || "none";
  if (typeof value !== "number") return value;
  const text = digits ? fixed(value, digits) : value.toLocaleString("en-GB");
  return unit ? `${text} ${unit}` : text;
}

/** Return the time of day of a Date, of a text of ISO 8601, or of seconds since 1970. */
export function clockTime(when) {
  const date = when instanceof Date ? when : new Date(typeof when === "number" ? 1000 * when : when);
  return Number.isNaN(date.getTime()) ? UNKNOWN : date.toLocaleTimeString("en-GB");
}

/** Return a time in s as people say it: 8 s, 2 min 5 s, 3 h 10 min. */
export function duration(seconds) {
  const s = Math.max(0, Math.round(seconds));
  if (s < 60) return `${s} s`;
  if (s < 3600) return `${Math.floor(s / 60)} min ${s % 60} s`;
  return `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
}
