"""Errors of fast waveforms that are learned from a table, on the simulated stages.

    python -m benchmarks.fast_stages [--seed 1] [STAGE ...]

Runs `config/experiments/fast.yaml` on each stage, and prints the largest errors of its waveforms
in % of the swing: before learning, and of the best pass. One stage takes about a minute.
"""

import argparse
from typing import Final

from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.config.play import PlayConfig
from piezod.devices import registry
from piezod.experiment.play.learn import RESPONSE, LearnedPlay
from piezod.experiment.virtual.play import run_plays
from piezod.plant.variants import VARIANTS
from tests.experiment.beyond import EXPERIMENTS, OTHER_FILES

COLUMNS: Final = ("unlearned", "measured", "true", "calibration", "apart from it")
OTHER_COMMANDS_UM: Final = {"afm": (6.0, 78.0), "flexure": (3.0, 30.2)}
"""Variant → lowest and highest command, if 80 % of the travel is not 3 to 28.6 µm."""
LEFT_OUT: Final = {"stack-uncalibrated", "no-antialias"}
"""Variants that differ from the stack by their sensor, which the file sets."""


def fast_experiment(variant: str, seed: int) -> ExperimentConfig:
    """Return the experiment on fast waveforms for a variant.

    Args:
        variant: Name of the variant.
        seed: Seed of the specimen.
    """
    config = load_experiment(EXPERIMENTS / "fast.yaml", registry)
    device = config.devices["rig"]
    options = device.options.model_copy(update={"variant": variant})
    devices = {"rig": device.model_copy(update={"options": options})}
    config = config.model_copy(update={"seed": seed, "devices": devices})
    if variant not in OTHER_COMMANDS_UM:
        return config
    # Travel and voltage are other ones: those of the variant's own experiment.
    own = load_experiment(EXPERIMENTS / OTHER_FILES[variant], registry)
    low_um, high_um = OTHER_COMMANDS_UM[variant]
    axis = config.axes["x"]
    drive_max_v = own.axes["x"].limits.drive_max_v
    limits = axis.limits.model_copy(update={"drive_max_v": drive_max_v})
    axis = axis.model_copy(update={"limits": limits, "command_range_um": (0.0, high_um + 1.0)})
    return config.model_copy(
        update={
            "axes": {"x": axis},
            "identification": own.identification,
            "play": _commanded(_plays(config), low_um, high_um),
        }
    )


def _plays(config: ExperimentConfig) -> PlayConfig:
    if config.play is None:
        raise SystemExit("fast.yaml has no play")
    return config.play


def _commanded(play: PlayConfig, low_um: float, high_um: float) -> PlayConfig:
    ends = {"low": low_um, "high": high_um}
    waves = [
        wave.model_copy(update={"command_um": wave.command_um.model_copy(update=ends)})
        for wave in play.waves
    ]
    return play.model_copy(update={"waves": tuple(waves)})


def largest_pct(variant: str, seed: int) -> list[float]:
    """Return the largest errors of all waveforms, in %, in the order of `COLUMNS`."""
    config = fast_experiment(variant, seed)
    (result,) = run_plays(config, _plays(config), lambda _label, _share: None).axes
    rows = [_errors_pct(play) for play in result.plays]
    return [max(column) for column in zip(*rows, strict=True)]


def _errors_pct(play: LearnedPlay) -> list[float]:
    (unlearned,) = (each for each in play.reports if each.label == RESPONSE)
    best = play.best
    return [unlearned.true.max_pct, best.measured.max_pct, best.true.max_pct, *best.limit]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="seed of the specimens")
    stages = [variant for variant in VARIANTS if variant not in LEFT_OUT]
    parser.add_argument("stages", nargs="*", default=stages, metavar="STAGE")
    arguments = parser.parse_args()
    print(f"{'stage':22} " + " ".join(f"{column:>13}" for column in COLUMNS))
    for stage in arguments.stages:
        errors_pct = largest_pct(stage, arguments.seed)
        print(f"{stage:22} " + " ".join(f"{error:13.2f}" for error in errors_pct), flush=True)


if __name__ == "__main__":
    main()
