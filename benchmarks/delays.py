"""True errors of sines with a sensor of any delay, at two rates: does learning make a motion worse?

    python -m benchmarks.delays [--rates 1000 10000] [--cycles 0 0.5 1 1.75] [--seed 1] [--csv FILE]
    python -m benchmarks.delays --rates 1000 --identified 10000 --cycles 0
    python -m benchmarks.delays --lifted mode

The stack, behind a sensor with its filter at 500 Hz and without, whose samples are later by some
cycles. It is identified at the rate of the loop, at 1 kHz as in `beyond.yaml`, then follows a sine
of 20 µm at each frequency. Prints the delay that was found, in cycles, and the worst true error in
`feedforward` / `adaptive` in % of the range; `!` where `adaptive` is worse by more than 0.02 %, `*`
where it exceeds 0.1 % at 5 Hz or 0.5 % at 20 Hz at 1 kHz. The calibration of the sensor is exact.
With `--identified` it is identified in a loop of another rate. `--lifted` names effects of the rig
that are left out. A cell takes half a minute at 1 kHz, some minutes at 10 kHz.
"""

import argparse
import csv
from pathlib import Path
from typing import Final

from piezod.config.modes import Mode
from tests.experiment.delayed import FREQUENCIES_HZ, SENSORS, errors_of, experiment

LARGEST_LOSS_PCT: Final = 0.02
LARGEST_PCT: Final = {5.0: 0.1, 20.0: 0.5}
"""Frequency in Hz → largest error in `adaptive` at 1 kHz, in %."""
SLOW_LOOP_HZ: Final = 1000.0


def row(variant: str, rate_hz: float, cycles: float, options: argparse.Namespace) -> list[str]:
    """Return a line of the table."""
    rig = {
        "calibration": {"kind": "commissioned", "residual_pct": 0.0},
        "effects": dict.fromkeys(options.lifted, False),
    }
    short, seed = (options.identified or rate_hz) > SLOW_LOOP_HZ, options.seed
    config = experiment(variant, rate_hz, cycles, FREQUENCIES_HZ, short=short, seed=seed, **rig)
    found = errors_of(config, options.identified)
    errors = []
    for case, frequency_hz in zip(config.cases, FREQUENCIES_HZ, strict=True):
        without, learning = (
            found.worst_pct[case.name, m] for m in (Mode.FEEDFORWARD, Mode.ADAPTIVE)
        )
        largest = LARGEST_PCT.get(frequency_hz) if rate_hz == SLOW_LOOP_HZ else None
        worse = "!" if learning > without + LARGEST_LOSS_PCT else ""
        large = "*" if largest is not None and learning > largest else ""
        errors.append(f"{without:.2f} / {learning:.2f} {worse}{large}".rstrip())
    sensor = "filtered" if variant == "stack" else "no filter"
    return [
        sensor,
        f"{rate_hz / 1000:g} kHz",
        f"{cycles:g}",
        f"{found.delay_s * rate_hz:.2f}",
        *errors,
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rates", type=float, nargs="+", default=[1000.0, 10_000.0], help="Hz")
    parser.add_argument("--cycles", type=float, nargs="+", default=[0.0, 0.5, 1.0, 1.75])
    parser.add_argument("--identified", type=float, help="rate of the identification, in Hz")
    parser.add_argument("--seed", type=int, default=1, help="seed of the specimen")
    parser.add_argument("--lifted", nargs="+", default=[], help="effects that are left out")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table there, too")
    arguments = parser.parse_args()
    head = ["sensor", "rate", "later, cycles", "delay found, cycles"]
    head += [f"{frequency_hz:g} Hz" for frequency_hz in FREQUENCIES_HZ]
    table = [head]
    print(" ".join(f"{name:>19}" for name in head))
    for rate_hz in arguments.rates:
        for variant in SENSORS:
            for cycles in arguments.cycles:
                line = row(variant, rate_hz, cycles, arguments)
                print(" ".join(f"{text:>19}" for text in line), flush=True)
                table.append(line)
    if arguments.csv:
        with arguments.csv.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(table)


if __name__ == "__main__":
    main()
