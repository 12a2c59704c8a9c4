/** Draws what has changed and can be seen, once for each frame of the screen. */

const FRAME_MS = 17;
const EARLY_MS = 8; // that is in time: frames come every 16 ms

/** Draws charts: objects with `element`, `draw(now_s)` and `each_ms`, the shortest time between two drawings. */
export class Painter {
  #charts = new Map(); // chart: { visible, dirty, drawn_ms }
  #elements = new Map();
  #frame = 0;
  #seen = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      const chart = this.#elements.get(target);
      const entry = this.#charts.get(chart);
      entry.visible = isIntersecting;
      if (isIntersecting) this.touch();
    }
  });
  #sized = new ResizeObserver((entries) => {
    for (const { target } of entries) {
      const chart = this.#elements.get(target);
      chart.resize?.(target.clientWidth, target.clientHeight);
      this.#charts.get(chart).drawn_ms = -Infinity;
    }
    this.touch();
  });

  add(chart) {
    this.#charts.set(chart, { visible: false, dirty: true, drawn_ms: -Infinity });
    this.#elements.set(chart.element, chart);
    this.#seen.observe(chart.element);
    this.#sized.observe(chart.element);
    return chart;
  }

  /** There are new data: draw all charts with the next frame. */
  touch() {
    for (const entry of this.#charts.values()) entry.dirty = true;
    this.#ask();
  }

  close() {
    cancelAnimationFrame(this.#frame);
    this.#seen.disconnect();
    this.#sized.disconnect();
    for (const chart of this.#charts.keys()) chart.close?.();
    this.#charts.clear();
  }

  #ask() {
    if (!this.#frame) this.#frame = requestAnimationFrame((now_ms) => this.#paint(now_ms));
  }

  #paint(now_ms) {
    this.#frame = 0;
    for (const [chart, entry] of this.#charts) {
      if (!entry.visible || !entry.dirty) continue;
      const left_ms = entry.drawn_ms + chart.each_ms - EARLY_MS - now_ms;
      if (left_ms > 0) {
        if (left_ms < FRAME_MS) this.#ask(); // else the next data ask for it
        continue;
      }
      entry.dirty = false;
      entry.drawn_ms = now_ms;
      chart.draw();
    }
  }
}
