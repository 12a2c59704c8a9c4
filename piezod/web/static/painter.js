/** Draws what has changed and can be seen, once for each frame of the screen. */

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
    if (!this.#frame) this.#frame = requestAnimationFrame((now_ms) => this.#paint(now_ms));
  }

  close() {
    cancelAnimationFrame(this.#frame);
    this.#seen.disconnect();
    this.#sized.disconnect();
    for (const chart of this.#charts.keys()) chart.close?.();
    this.#charts.clear();
  }

  #paint(now_ms) {
    this.#frame = 0;
    for (const [chart, entry] of this.#charts) {
      // A few ms early is in time: frames come every 16 ms.
      if (!entry.visible || !entry.dirty || now_ms - entry.drawn_ms < chart.each_ms - 8) continue;
      entry.dirty = false;
      entry.drawn_ms = now_ms;
      chart.draw();
    }
  }
}
