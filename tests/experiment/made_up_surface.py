"""Records of a stage that is a surface, whose model a fit can find exactly."""

from collections.abc import Callable

import numpy as np

from piezod.control.law.creep import logarithmic
from piezod.experiment.fit.record import Record
from piezod.hysteresis import SurfaceForm, add_creep
from piezod.hysteresis.everett import SIZE, surface
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.path_relaxation import PathRelaxation
from tests.experiment.made_up import DRIVE_V, POSITION_UM, RATE_HZ, swells
from tests.hysteresis.surfaces import invertible_with

FINER = 20
"""Simulation steps per sample period."""


def made_up_surface() -> FloatArray:
    """Return coefficients, shape (24,), of an asymmetric surface from 0 to 1."""
    coefficients = np.zeros(SIZE)
    coefficients[[0, 1, 4, 8]] = 1.0, 0.04, 0.12, -0.03
    return coefficients / surface(coefficients, 1.0, 0.0)[0]


def all_loops(t_s: FloatArray) -> FloatArray:
    """Return a drive in [0, 1] with loops of all sizes and heights; (n,) for (n,) in s."""
    shrinking = 0.5 * np.exp(-t_s / 8.0) * (1.0 - np.cos(2.0 * np.pi * 0.8 * t_s))
    grows = 1.0 - np.exp(-t_s / 8.0)
    slow = 0.42 * grows * (1.0 - np.cos(2.0 * np.pi * 0.06 * t_s))
    small = 0.08 * grows * (1.0 - np.cos(2.0 * np.pi * 1.1 * t_s))
    return shrinking + slow + small


def two_frequencies(t_s: FloatArray) -> FloatArray:
    """Return a drive in [0, 1] that separates delay, lag and hysteresis; (n,) for (n,) in s."""
    drives: FloatArray = 0.7 * swells(t_s) + 0.15 * (1.0 - np.cos(2.0 * np.pi * 2.3 * t_s))
    return drives / float(drives.max())


def surface_record(
    *,
    weights: FloatArray | None = None,
    drive: Callable[[FloatArray], FloatArray] = all_loops,
    duration_s: float = 40.0,
    delay_s: float = 0.0,
    creep: float = 0.0,
    offset: float = 0.0,
    activation: float = 0.0,
    noise: float = 0.0,
    seed: int = 1,
    path: PathRelaxation | None = None,
) -> Record:
    """Return a record of the made-up stage.

    Args:
        weights: Coefficients of its surface, shape (24,); by default those of `made_up_surface`.
        drive: Drive over time, (n,) for (n,) in s.
        duration_s: Length, in s.
        delay_s: Delay of the displacement behind the drive, in s; of either sign.
        creep: Weight of each lag of its creep.
        offset: Displacement at the start, as a share of the range.
        activation: Growth of the lag of its hysteresis per e-fold of the rate, as a share of the
            drive's range; 0 for a stage whose loops do not widen with the rate.
        noise: Standard deviation of the sensor's noise, as a share of the range.
        seed: Seed of the noise.
        path: Part of its displacement that relaxes along the path of the drive.
    """
    step_s = 1.0 / (RATE_HZ * FINER)
    fine_s: FloatArray = step_s * np.arange(round(duration_s / step_s), dtype=np.float64)
    drives = np.clip(drive(fine_s), 0.0, 1.0)
    form = SurfaceForm(activation, 0.3 if activation else 0.0, step_s, path)
    surface_weights = made_up_surface() if weights is None else weights
    if path is not None:
        surface_weights = invertible_with(path, surface_weights)
    x = form.positions_at(surface_weights, drives)
    law = logarithmic(creep)
    x = add_creep(law.at(step_s), x, np.zeros(law.weights.size))
    t_s = fine_s[::FINER]
    late = offset + np.interp(t_s - delay_s, fine_s, x)
    late += noise * np.random.default_rng(seed).standard_normal(late.size)
    return Record(t_s, DRIVE_V * drives[::FINER], POSITION_UM * late)
