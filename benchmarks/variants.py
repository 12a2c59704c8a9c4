"""True errors of the experiment beyond the paper on every simulated stage, for several specimens.

    python -m benchmarks.variants [--seeds 1 2 3 4 5] [STAGE ...]

Prints for each stage and specimen the worst of the three cases in % of the range of a case, and at
the end of each stage the worst of its specimens. One specimen takes about half a minute.
"""

import argparse
from collections.abc import Iterator

from piezod.config.modes import Mode
from piezod.experiment.virtual.run import run_experiment
from piezod.plant.variants import VARIANTS
from tests.experiment.beyond import experiment_of

MODES = (Mode.FEEDFORWARD, Mode.ADAPTIVE, Mode.TRIMMED)
METRIC = "true_tracking_max_pct"


def worst_pct(variant: str, seed: int) -> list[float]:
    """Return the worst true tracking error of each mode, in %."""
    config = experiment_of(variant, seed).model_copy(update={"modes": MODES})
    result = run_experiment(config, "", config.title, lambda _label, _share: None)
    return [
        max(each.metrics[METRIC] for each in result.recordings if each.mode == mode)
        for mode in MODES
    ]


def lines(variants: list[str], seeds: list[int]) -> Iterator[str]:
    """Yield the lines of the table."""
    yield f"{'stage':22} {'seed':>5} " + " ".join(f"{mode:>12}" for mode in MODES)
    for variant in variants:
        rows = []
        for seed in seeds:
            rows.append(worst_pct(variant, seed))
            yield _line(variant, str(seed), rows[-1])
        yield _line(variant, "worst", [max(column) for column in zip(*rows, strict=True)])


def _line(variant: str, seed: str, errors_pct: list[float]) -> str:
    return f"{variant:22} {seed:>5} " + " ".join(f"{error:12.2f}" for error in errors_pct)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("variants", nargs="*", default=list(VARIANTS), metavar="STAGE")
    arguments = parser.parse_args()
    for line in lines(arguments.variants, arguments.seeds):
        print(line, flush=True)


if __name__ == "__main__":
    main()
