/** Statistics of a signal: its distribution and its spectrum. Pure functions of arrays. */

export const SEGMENT = 256; // samples of a segment of the spectrum
const COSINES = Array.from({ length: SEGMENT }, (_, k) => Math.cos((2 * Math.PI * k) / SEGMENT));
const WINDOW = COSINES.map((cosine) => (1 - cosine) / 2); // von Hann
const WINDOW_POWER = WINDOW.reduce((sum, each) => sum + each * each, 0);

/** Return the root of the mean square of the known values; null if there are none. */
export function rms(values) {
  const known = values.filter((each) => each != null);
  if (!known.length) return null;
  return Math.sqrt(known.reduce((sum, each) => sum + each * each, 0) / known.length);
}

/**
 * Return the distribution of the known values: centres of the bins, and the share in each in %.
 *
 * The bins are symmetric around zero, and their width is 1, 2 or 5 times a power of ten.
 */
export function histogram(values, least) {
  const known = values.filter((each) => each != null);
  const most = Math.max(least, ...known.map(Math.abs));
  const width = niceStep(most / 12);
  const half = Math.ceil(most / width - 0.5);
  const counts = new Array(2 * half + 1).fill(0);
  for (const each of known) counts[half + Math.round(each / width)] += 1;
  const centres = counts.map((_, index) => (index - half) * width);
  return { centres, width, shares: counts.map((count) => (known.length ? (100 * count) / known.length : null)) };
}

/** Return the smallest of 1, 2 and 5 times a power of ten that is not below a value. */
export function niceStep(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 5, 10].find((each) => each * power >= value * (1 - 1e-9));
}

/**
 * Return the amplitude spectral density of the newest values without a gap.
 *
 * Segments with a window of von Hann overlap by half; their powers are averaged (Welch).
 *
 * @param {Array<number|null>} values Samples at a constant rate.
 * @param {number} rate_hz Their rate.
 * @returns {{frequencies_hz: number[], density: number[], segments: number}} Density in the unit of the
 *   values per √Hz; nothing if the run is shorter than a segment.
 */
export function spectrum(values, rate_hz) {
  const run = values.slice(values.lastIndexOf(null) + 1);
  const power = new Array(SEGMENT / 2).fill(0);
  let segments = 0;
  for (let end = run.length; end >= SEGMENT; end -= SEGMENT / 2) {
    addPower(power, run.slice(end - SEGMENT, end));
    segments += 1;
  }
  if (!segments) return { frequencies_hz: [], density: [], segments };
  const scale = 2 / (rate_hz * WINDOW_POWER * segments); // one-sided
  const bins = power.map((_, bin) => bin).slice(1); // without the mean
  return {
    frequencies_hz: bins.map((bin) => (bin * rate_hz) / SEGMENT),
    density: bins.map((bin) => Math.sqrt(power[bin] * scale)),
    segments,
  };
}

/** Add the power of a segment in each bin: a sum of products is fast enough for 256 samples. */
function addPower(power, segment) {
  const mean = segment.reduce((sum, each) => sum + each, 0) / SEGMENT;
  const windowed = segment.map((each, index) => (each - mean) * WINDOW[index]);
  for (let bin = 1; bin < power.length; bin += 1) {
    let real = 0;
    let imaginary = 0;
    for (let index = 0; index < SEGMENT; index += 1) {
      const angle = (bin * index) % SEGMENT;
      real += windowed[index] * COSINES[angle];
      imaginary += windowed[index] * COSINES[(angle + (3 * SEGMENT) / 4) % SEGMENT];
    }
    power[bin] += real * real + imaginary * imaginary;
  }
}
