"""True errors of the experiment beyond the paper on every simulated stage, for several specimens.

    python -m benchmarks.variants [--seeds 1 2 3 4 5] [--csv FILE] [STAGE ...]
    python -m benchmarks.variants --limits [--seeds 1] [--csv FILE] [STAGE ...]
    python -m benchmarks.variants --foreign [--small] [--seeds 1 2 3 4 5] [--csv FILE]

Prints for each stage and specimen the worst of the three cases in % of the range of a case, and at
the end of each stage the worst of its specimens. One specimen takes about half a minute. With
`--limits` it prints the errors of the stages that miss a target, and those without the effect that
limits them; with `--foreign` those of the stages that no model describes; with `--small` those of
loops of 2 to 10 % of the travel, in % of the loop. `--csv` writes the worst of each stage:
`docs/measured/specimens.csv` and `limits.csv` are such files.
"""

import argparse
import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from piezod.config.modes import Mode
from piezod.errors import DataError
from piezod.experiment.virtual.run import run_experiment
from piezod.plant.variants import VARIANTS
from tests.experiment.beyond import FOREIGN, LIMITS, experiment_of, small_loops

MODES = (Mode.FEEDFORWARD, Mode.ADAPTIVE, Mode.TRIMMED)
METRIC = "true_tracking_max_pct"
WORST = "worst"
"""In place of a seed: the worst of the specimens."""


class Line(NamedTuple):
    """A line of the table.

    Attributes:
        variant: Name of the variant.
        seed: Seed of the specimen, or `WORST`.
        errors_pct: Worst true tracking error of each of `MODES`; none if there was no run.
        lifted: What does not limit the errors here, or why there was no run.
    """

    variant: str
    seed: str
    errors_pct: list[float]
    lifted: str = ""

    def __str__(self) -> str:
        """Return the line as it is printed."""
        errors = " ".join(f"{error:12.2f}" for error in self.errors_pct)
        return f"{self.variant:22} {self.seed:>5} {errors}  {self.lifted}".rstrip()


def worst_pct(variant: str, seed: int, *, small: bool = False, **rig: Any) -> list[float]:
    """Return the worst true tracking error of each mode, in %.

    Args:
        variant: Name of the variant.
        seed: Seed of the specimen.
        small: Whether the cases are small loops.
        rig: Further options of the rig.
    """
    config = experiment_of(variant, seed, **rig).model_copy(update={"modes": MODES})
    if small:
        config = small_loops(config)
    result = run_experiment(config, "", config.title, lambda _label, _share: None)
    return [
        max(each.metrics[METRIC] for each in result.recordings if each.mode == mode)
        for mode in MODES
    ]


def lines(variants: list[str], seeds: list[int], *, small: bool = False) -> Iterator[Line]:
    """Yield the lines of the table."""
    for variant in variants:
        rows = []
        for seed in seeds:
            try:
                rows.append(worst_pct(variant, seed, small=small))
            except DataError as error:  # a slow amplifier may not reach the range of the cases
                yield Line(variant, str(seed), [], f"refused: {error}")
            else:
                yield Line(variant, str(seed), rows[-1])
        yield Line(variant, WORST, [max(column) for column in zip(*rows, strict=True)])


def limits(variants: list[str], seeds: list[int]) -> Iterator[Line]:
    """Yield the lines of the table of the limits, each the worst of the specimens."""
    known: set[str] = set()
    for limit in LIMITS:
        if limit.variant not in variants:
            continue
        if limit.variant not in known:
            yield Line(limit.variant, WORST, _worst_of(limit.variant, seeds))
            known.add(limit.variant)
        errors_pct = _worst_of(limit.variant, seeds, **limit.rig)
        yield Line(limit.variant, WORST, errors_pct, limit.lifted)


def _worst_of(variant: str, seeds: list[int], **rig: Any) -> list[float]:
    rows = [worst_pct(variant, seed, **rig) for seed in seeds]
    return [max(column) for column in zip(*rows, strict=True)]


def write_csv(path: Path, table: list[Line]) -> None:
    """Write the worst of each stage."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("stage", "changed", *MODES))
        for line in table:
            if line.seed == WORST:
                errors = (f"{error:.2f}" for error in line.errors_pct)
                writer.writerow((line.variant, line.lifted, *errors))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", help="1 2 3 4 5, with --limits 1")
    parser.add_argument("--limits", action="store_true", help="without what limits the errors")
    parser.add_argument("--foreign", action="store_true", help="stages that no model describes")
    parser.add_argument("--small", action="store_true", help="small loops, in %% of the loop")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the worst ones there, too")
    parser.add_argument("variants", nargs="*", metavar="STAGE")
    arguments = parser.parse_args()
    seeds = arguments.seeds or ([1] if arguments.limits else [1, 2, 3, 4, 5])
    variants = arguments.variants or list(FOREIGN if arguments.foreign else VARIANTS)
    small = arguments.small
    table = limits(variants, seeds) if arguments.limits else lines(variants, seeds, small=small)
    print(f"{'stage':22} {'seed':>5} " + " ".join(f"{mode:>12}" for mode in MODES))
    found = []
    for line in table:
        print(line, flush=True)
        found.append(line)
    if arguments.csv:
        write_csv(arguments.csv, found)


if __name__ == "__main__":
    main()
