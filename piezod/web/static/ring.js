/** The last minutes of telemetry of one axis, in columns for the charts. */

const GAP_S = 0.5;
const USUAL_S = 1 / 30; // time of an interval, if the one before is not known

/**
 * Columns of the same length that forget their oldest entries.
 *
 * The arrays are twice as long as what is kept, so that the kept part moves only now and then.
 */
class Columns {
  constructor(names, kept) {
    this.kept = kept;
    this.arrays = Object.fromEntries(names.map((name) => [name, new Array(2 * kept).fill(null)]));
    this.end = 0;
  }

  push(values) {
    if (this.end === 2 * this.kept) {
      for (const array of Object.values(this.arrays)) array.copyWithin(0, this.kept);
      this.end = this.kept;
    }
    for (const name in this.arrays) this.arrays[name][this.end] = values[name] ?? null;
    this.end += 1;
  }

  /** Return the index of the first entry at or after a time. */
  from(time_s) {
    let low = Math.max(0, this.end - this.kept);
    let high = this.end;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.arrays.time_s[middle] < time_s) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** Return copies of columns from a time on. */
  since(time_s, names) {
    const begin = this.from(time_s);
    return names.map((name) => this.arrays[name].slice(begin, this.end));
  }
}

const RANGES = ["command_um", "position_um", "error_um", "drive_v"];

/**
 * Telemetry of one axis.
 *
 * `lines` has two entries for each interval: its minimum and its maximum, in the order in which the
 * signal most likely passed them. A line through them hides no cycle. `samples` has the last
 * cycle of each interval: values of one instant, which belong together.
 */
export class Ring {
  constructor(kept = 4096) {
    this.kept = kept;
    this.clear();
  }

  /** Forget everything. */
  clear() {
    this.lines = new Columns(["time_s", ...RANGES, "late_max_us"], 2 * this.kept);
    this.samples = new Columns(["time_s", ...RANGES], this.kept);
    this.newest = null; // the newest row, as one object
    this.lastTime_s = 0;
  }

  /** Take an event of telemetry. */
  take(event, axisName) {
    const axis = event.axes[axisName];
    if (!axis) return;
    event.unix_s.forEach((time_s, row) => this.#push(time_s, row, event, axis));
  }

  #push(time_s, row, event, axis) {
    let step_s = time_s - this.lastTime_s;
    if (step_s < -GAP_S) this.clear(); // the clock of the computer was set back
    else if (step_s <= 0) return;
    if (Math.abs(step_s) > GAP_S) {
      if (this.lastTime_s) this.gap(this.lastTime_s + 1e-3);
      step_s = USUAL_S;
    }
    const [early, late, sample] = [{}, {}, { time_s }];
    for (const name of RANGES) {
      const { min, max, last } = { min: axis[name].min[row], max: axis[name].max[row], last: axis[name].last[row] };
      const rising = last == null || Math.abs(max - last) <= Math.abs(last - min);
      early[name] = rising ? min : max;
      late[name] = rising ? max : min;
      sample[name] = last;
    }
    early.late_max_us = late.late_max_us = event.late_max_us[row];
    // The first cycle of the interval, so that a steady motion gives a straight line.
    const cycles = Math.max(1, event.cycles[row]);
    early.time_s = time_s - step_s * (1 - 1 / cycles);
    late.time_s = time_s;
    this.lines.push(early);
    this.lines.push(late);
    this.samples.push(sample);
    this.lastTime_s = time_s;
    this.newest = {
      ...sample,
      late_max_us: event.late_max_us[row],
      state: event.state[row],
      cycles: event.cycles[row],
      lost: event.lost[row],
      skipped_cycles: event.skipped_cycles[row],
      target_um: axis.target_um[row],
      on_target: axis.on_target[row],
      mode: axis.mode[row],
    };
  }

  /** Interrupt the lines: nothing is known between this time and the next row. */
  gap(time_s) {
    this.lines.push({ time_s });
    this.samples.push({ time_s });
  }
}
