"""Records of a stage made of stops, whose model a fit can find exactly."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from piezod.control.law.creep import logarithmic
from piezod.control.law.model import StageModel
from piezod.experiment.fit.record import Record
from piezod.hysteresis import InverseMPI, StopForm, add_creep, even_thresholds
from piezod.hysteresis.memory import FloatArray
from piezod.records.csv_file import write_csv

ORDER = 6
RATE_HZ = 100.0
DRIVE_V = 150.0
POSITION_UM = 30.0
FINER = 50
"""Simulation steps per sample period, for delays of fractions of a period."""

LEFT_WEIGHTS = np.array([0.12, 0.05, 0.04, 0.03, 0.03, 0.02])
RIGHT_WEIGHTS = np.array([0.10, 0.06, 0.03, 0.04, 0.02, 0.03])


def made_up_inverse() -> InverseMPI:
    """Return the inverse model of the made-up stage."""
    thresholds = even_thresholds(ORDER)
    return InverseMPI(thresholds, thresholds, RIGHT_WEIGHTS, LEFT_WEIGHTS)


def stops_of(model: StageModel) -> StopForm:
    """Return the form of a model that is a sum of stops."""
    assert isinstance(model.form, StopForm)
    return model.form


def inverse_of(model: StageModel) -> InverseMPI:
    """Return the inverse model of a stage in closed form."""
    return stops_of(model).inverse(model.weights)


def loops(t_s: FloatArray) -> FloatArray:
    """Return a displacement in [0, 1] with loops of many sizes, from rest; (n,) for (n,) in s."""
    shrinking = 0.5 * np.exp(-t_s / 12.0) * (1.0 - np.cos(2.0 * np.pi * 0.8 * t_s))
    small = 0.2 * (1.0 - np.cos(2.0 * np.pi * 0.31 * t_s)) * (1.0 - np.exp(-t_s / 12.0))
    return shrinking + small


def sine(t_s: FloatArray) -> FloatArray:
    """Return a displacement in [0, 1] of one frequency, from rest; (n,) for (n,) in s."""
    return 0.5 * (1.0 - np.cos(2.0 * np.pi * 0.8 * t_s))


def swells(t_s: FloatArray) -> FloatArray:
    """Return loops that shrink and grow over the whole range every 12.5 s; (n,) for (n,) in s."""
    swing = 0.55 + 0.45 * np.cos(2.0 * np.pi * t_s / 12.5)
    return 0.5 - 0.5 * swing * np.cos(2.0 * np.pi * 0.8 * t_s)


def record_of(
    *,
    delay_periods: float = 0.0,
    duration_s: float = 25.0,
    path: Callable[[FloatArray], FloatArray] = loops,
    creep: float = 0.0,
    noise: float = 0.0,
) -> Record:
    """Return a record of the made-up stage.

    Args:
        delay_periods: How long the displacement lags behind the drive, in sample periods; rounded
            to 1 / FINER.
        duration_s: Length, in s.
        path: Displacement without creep over time, (n,) for (n,) in s.
        creep: Weight of each lag of its creep.
        noise: Standard deviation of the sensor's noise, as a share of the range.
    """
    t_s = np.arange(round(duration_s * RATE_HZ) * FINER) / (RATE_HZ * FINER)
    x = path(t_s)
    x /= x.max()
    v = made_up_inverse().run(x)
    law = logarithmic(creep)
    x = add_creep(law.at(1.0 / (RATE_HZ * FINER)), x, np.zeros(law.weights.size))
    x += noise * np.random.default_rng(1).normal(size=x.size)
    late = np.concatenate((np.zeros(round(delay_periods * FINER)), x))
    return Record(t_s[::FINER], DRIVE_V * v[::FINER], POSITION_UM * late[: t_s.size : FINER])


def write_record(path: Path, record: Record) -> None:
    """Write a record as a data file."""
    columns = {"t_s": record.t_s, "drive_v": record.drive_v, "position_um": record.position_um}
    write_csv(path, columns)
