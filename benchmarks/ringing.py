"""Records of simulated stages that ring, for `piezod identify`.

`python -m benchmarks.ringing FOLDER` drives a stage at 10 kHz without an anti-alias filter with
random voltages, each held for 0.5 to 5 ms (`random`, `random-test`) or for 20 to 80 ms (`steps`,
`steps-test`), after a slow start with all loops, and writes a data file of each.

`python -m benchmarks.ringing --seeds 20` finds the first mode of that many specimens in such
records, and compares its deviations from the true mode with the stated uncertainty (half a minute
for each specimen).
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from benchmarks.peers.simulated import BEYOND, FULL_V
from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.control.law.first_mode import FirstMode
from piezod.devices import registry
from piezod.experiment.fit.errors import cross_validate
from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.uncertainty import SIGMAS_95, uncertainty_of
from piezod.experiment.virtual.stage import IN_FORCE_V, POSITION_UM, opened
from piezod.hysteresis.memory import FloatArray
from piezod.records.csv_file import write_csv
from piezod.units import NS_PER_S
from piezod_drivers.simulated.axis import make_axis
from piezod_drivers.simulated.options import SimulatedOptions

RATE_HZ: Final = 10_000.0
SLEW_V_PER_S: Final = 30_000.0
"""The amplifier of the stage follows this slew rate, so that the recorded voltage is its own."""
SLOW_S: Final = 2.0
HELD_S: Final = {"random": (0.0005, 0.005), "steps": (0.02, 0.08)}
"""Shortest and longest time for which a voltage is held, by the name of the drive, in s."""


def drive(held_s: tuple[float, float], seed: int) -> FloatArray:
    """Return voltages over time: a slow start with all loops, then random ones, shape (n,).

    Args:
        held_s: Shortest and longest time for which a voltage is held, in s.
        seed: Seed of the random part.
    """
    random = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, round(SLOW_S * RATE_HZ), endpoint=False)
    slow = 0.5 * np.exp(-3.0 * t) * (1.0 - np.cos(24.0 * np.pi * t))
    slow += (1.0 - np.exp(-3.0 * t)) * (
        0.42 * (1.0 - np.cos(4.0 * np.pi * t)) + 0.08 * (1.0 - np.cos(34.0 * np.pi * t))
    )
    parts = [np.clip(slow, 0.0, 1.0)]
    while sum(part.size for part in parts) < 2 * t.size:
        parts.append(np.full(round(random.uniform(*held_s) * RATE_HZ), random.uniform(0.02, 0.98)))
    return 0.98 * FULL_V * np.concatenate(parts)[: 2 * t.size]


def record(config: ExperimentConfig, drive_v: FloatArray) -> dict[str, FloatArray]:
    """Drive the stage of an experiment from rest; return the columns of a data file."""
    with opened(config, lambda _cycles: None) as stage:
        stage.rest(1.0)
        last = drive_v.size - 1
        waveform = [lambda t_s: float(drive_v[min(round(t_s * RATE_HZ), last)])]
        trace = stage.open_loop(waveform, drive_v.size / RATE_HZ)[0]
        t_s = np.arange(trace.shape[0]) * (stage.period_ns / NS_PER_S)
    return {"t_s": t_s, "drive_v": trace[:, IN_FORCE_V], "position_um": trace[:, POSITION_UM]}


def experiment(folder: Path) -> ExperimentConfig:
    """Return the experiment `beyond.yaml` at the rate of the records, written to a folder."""
    document: dict[str, Any] = yaml.safe_load(BEYOND.read_text(encoding="utf-8"))
    document["rate_hz"] = RATE_HZ
    document["modes"] = ["uncompensated"]
    document["devices"]["rig"]["options"]["variant"] = "no-antialias"
    document["axes"]["x"]["limits"]["slew_v_per_s"] = SLEW_V_PER_S
    del document["axes"]["x"]["trim"]
    path = folder / "experiment.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return load_experiment(path, registry)


def true_mode(config: ExperimentConfig) -> FirstMode:
    """Return the first mode of the specimen of an experiment."""
    device = config.devices["rig"]
    seed = np.random.SeedSequence(config.seed).spawn(1)[0]
    stage = make_axis(SimulatedOptions(**device.options.model_dump()), seed).plant.parameters.stage
    return FirstMode(stage.mode_hz, stage.mode_damping)


def deviations(config: ExperimentConfig, held_s: tuple[float, float]) -> FloatArray:
    """Return the deviations of frequency and damping, in stated standard errors, shape (2,)."""
    columns = record(config, drive(held_s, config.seed))
    found = Record(columns["t_s"], columns["drive_v"], columns["position_um"])
    fit = fit_model(found, FitSettings(method=Method.SURFACE, creep=True))
    half = uncertainty_of(fit, cross_validate(fit)).mode
    assert fit.model.mode is not None  # noqa: S101 - every such record shows it
    assert half is not None  # noqa: S101 - as the mode
    errors = np.array(fit.model.mode) - np.array(true_mode(config))
    return np.asarray((SIGMAS_95 * errors / np.array(half))[:2])


def lines(count: int) -> Iterator[str]:
    """Yield the lines of the table: deviations of each specimen, and how many are small."""
    with tempfile.TemporaryDirectory() as folder:
        config = experiment(Path(folder))
    yield "deviations of frequency and damping, in stated standard errors"
    for name, held_s in HELD_S.items():
        rows = []
        for seed in range(1, count + 1):
            rows.append(deviations(config.model_copy(update={"seed": seed}), held_s))
            yield f"{name:8} seed {seed:2} {rows[-1][0]:6.2f} {rows[-1][1]:6.2f}"
        for sigmas in (1, 2):
            share = 100.0 * np.mean(np.abs(rows) <= sigmas, axis=0)
            yield f"{name:8} within {sigmas} {share[0]:4.0f} % {share[1]:4.0f} %"


def main() -> None:
    """Write all records, or print the deviations."""
    parser = argparse.ArgumentParser("python -m benchmarks.ringing", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path())
    parser.add_argument("--seeds", type=int, metavar="N", help="compare the modes of N specimens")
    arguments = parser.parse_args()
    if arguments.seeds:
        for line in lines(arguments.seeds):
            print(line, flush=True)
        return
    folder = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    config = experiment(folder)
    for name, held_s in HELD_S.items():
        for seed, suffix in enumerate(("", "-test"), start=1):
            write_csv(folder / f"{name}{suffix}.csv", record(config, drive(held_s, seed)))


if __name__ == "__main__":
    main()
