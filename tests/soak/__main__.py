"""A soak: `python -m tests.soak --hours 24`, as `make soak HOURS=24` runs it.

Writes soak.csv, soak.png, the log of the daemons, and soak.json: `docs/measured` has that of a day.
Exits with 1 if a limit was broken, a state or fault had no cause, the stage did not recover, or
memory, descriptors or errors grew too much.
"""

import argparse
import csv
import gc
import json
import math
import secrets
import signal
import sys
from pathlib import Path
from typing import Any

from piezod.records.figures.style import save_png
from tests.control.surface_rig import VARIANTS
from tests.soak.figure import soak_figure
from tests.soak.observer import Row
from tests.soak.soak import ERROR_RMS_PCT, RATE_HZ, Result, soak


def main() -> int:
    """Run, write, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0, help="simulated time")
    parser.add_argument("--rate", type=float, default=RATE_HZ, help="rate of the loop, in Hz")
    parser.add_argument("--model", choices=VARIANTS, default="stops", help="model of the stage")
    parser.add_argument("--seed", type=int, default=None, help="seed; drawn if not given")
    parser.add_argument("--out", type=Path, default=Path("build/soak"), help="folder to write")
    chosen = parser.parse_args()
    seed = secrets.randbelow(10**6) if chosen.seed is None else chosen.seed
    chosen.out.mkdir(parents=True, exist_ok=True)
    print(f"seed {seed}: {chosen.hours:g} h at {chosen.rate:g} Hz, {chosen.model}", flush=True)

    def progress(elapsed_s: float, rows: list[Row]) -> None:
        print(f"{elapsed_s / 3600:6.2f} h", flush=True)
        write_csv(chosen.out / "soak.csv", rows)  # so that an end by force leaves something

    signals: list[int] = []  # SIGINT or SIGTERM ends it early; what there is will be judged
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda got, _frame: signals.append(got))
    gc.collect()
    gc.freeze()  # what has been imported stays
    result = soak(
        3600 * chosen.hours,
        seed,
        chosen.out / "log",
        chosen.rate,
        chosen.model,
        progress,
        lambda: bool(signals),
    )
    if result.rows:
        what = f"{result.rows[-1].hour:.1f} simulated hours of a daemon"
        title = f"{what} at {chosen.rate:g} Hz, seed {seed}"
        save_png(chosen.out / "soak.png", soak_figure(result.rows, title, ERROR_RMS_PCT))
        numbers = {"hours": chosen.hours, "rate_hz": chosen.rate, "model": chosen.model}
        text = json.dumps(numbers | document(result), indent=2)
        (chosen.out / "soak.json").write_text(f"{text}\n", encoding="utf-8")
    print(summary(result))
    for violation in result.violations:
        print(f"VIOLATION {violation}")
    return 1 if result.violations else 0


def write_csv(path: Path, rows: list[Row]) -> None:
    """Write one line for each simulated minute."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(Row._fields)
        writer.writerows([f"{value:.7g}" for value in row] for row in rows)


def document(result: Result) -> dict[str, Any]:
    """Return the numbers of a run for a table."""
    rows, steps = result.rows, result.rig.output.steps_v
    errors = sorted(row.error_rms_pct for row in rows if not math.isnan(row.error_rms_pct)) or [0.0]
    done = result.commands.done
    return {
        "seed": result.seed,
        "processor_min": round(result.took_s[1] / 60),
        "faults": rows[-1].faults,
        "output_faults": rows[-1].output_faults,
        "daemons": rows[-1].daemons,
        "plays": sum(count for name, count in done.items() if name.startswith("play")),
        "writes": result.rig.writes,
        "piezod_step_v": round(result.rig.largest_v, 1),
        "amplifier_step_v": round(max(steps.values(), default=0.0), 1),
        "error_rms_median_pct": round(errors[len(errors) // 2], 2),
        "error_rms_worst_pct": round(errors[-1], 2),
        "drift_worst_pct": round(max(0.0, *(row.drift_pct for row in rows)), 1),
        "violations": len(result.violations),
    }


def summary(result: Result) -> str:
    """Return what was done, in some lines."""
    observer, commands, rig = result.observer, result.commands, result.rig
    wall_s, cpu_s = result.took_s
    shares = {state: count / observer.cycles for state, count in observer.states.most_common()}
    steps = sorted(rig.output.steps_v.items())
    return "\n".join(
        (
            f"cycles {observer.cycles}, writes {rig.writes}, daemons {observer.daemons}; "
            f"took {wall_s:.0f} s, {cpu_s:.0f} s of a processor, "
            f"{1e6 * cpu_s / observer.cycles:.0f} µs a cycle",
            "states " + ", ".join(f"{state} {share:.2%}" for state, share in shares.items()),
            "faults " + ", ".join(f"{each} {n}" for each, n in observer.seen.most_common()),
            "done " + ", ".join(f"{name} {n}" for name, n in sorted(commands.done.items())),
            "refused " + ", ".join(f"{name} {n}" for name, n in sorted(commands.refused.items())),
            f"writes stayed {rig.closest_v:.3g} V or more from the largest step, and "
            f"{rig.near_v:.3g} V from the largest distance to the output",
            f"largest step by piezod {rig.largest_v:.4g} V; by the amplifier "
            + (", ".join(f"{kind} {v:.4g} V" for kind, v in steps) or "none"),
            f"writes that no witness could judge: {rig.apart} beyond the bound, the largest "
            f"{rig.apart_v:.4g} V",
        )
    )


if __name__ == "__main__":
    sys.exit(main())
