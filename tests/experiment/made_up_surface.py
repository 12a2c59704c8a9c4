"""Records of a stage whose hysteresis is a surface, with creep, an offset and any delay."""

import numpy as np

from piezod.control.law.creep import logarithmic
from piezod.experiment.fit.creep_regressors import with_creep
from piezod.experiment.fit.record import Record
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.path_relaxation import PathRelaxation
from piezod.hysteresis.surface_form import SurfaceForm
from tests.control.made_up import SURFACE
from tests.experiment.made_up import DRIVE_V, FINER, POSITION_UM, RATE_HZ, swells
from tests.hysteresis.surfaces import invertible_with


def several(t_s: FloatArray) -> FloatArray:
    """Return drives in [0, 1] of several frequencies, from rest; (n,) for (n,) in s."""
    return 0.7 * swells(t_s) + 0.15 * (1.0 - np.cos(2.0 * np.pi * 2.3 * t_s))


def surface_record(
    *,
    delay_periods: float = 0.0,
    duration_s: float = 25.0,
    creep: float = 0.0,
    offset: float = 0.0,
    noise: float = 0.0,
    seed: int = 1,
    one_frequency: bool = False,
    activation: float = 0.0,
    path: PathRelaxation | None = None,
) -> Record:
    """Return a record of the made-up stage.

    Args:
        delay_periods: How long the displacement lags behind the drive, in sample periods, of either
            sign; rounded to 1 / FINER.
        duration_s: Length, in s.
        creep: Weight of each lag of its creep.
        offset: Displacement at the start, as a share of the range.
        noise: Standard deviation of the noise of the sensor, as a share of the range.
        seed: Seed of the noise.
        one_frequency: Whether the drive has a single frequency.
        activation: Growth of the lag of its hysteresis per e-fold of the rate, as a share of the
            drive's range; 0 for a stage whose loops do not widen with the rate.
        path: Part of its displacement that relaxes along the path of the drive.
    """
    step_s = 1.0 / (RATE_HZ * FINER)
    t_s: FloatArray = np.arange(round(duration_s * RATE_HZ) * FINER, dtype=np.float64) * step_s
    drives = swells(t_s) if one_frequency else several(t_s)
    drives /= drives.max()
    form = SurfaceForm(activation, 0.3 if activation else 0.0, step_s, path)
    weights = invertible_with(path, SURFACE.weights) if path else SURFACE.weights
    quick = form.positions_at(weights, drives)[:, np.newaxis]
    moved = with_creep(quick, logarithmic(creep).weights, step_s)[:, 0] + offset
    samples = np.arange(0, t_s.size, FINER)
    shown = moved[np.clip(samples - round(delay_periods * FINER), 0, t_s.size - 1)]
    shown += noise * np.random.default_rng(seed).standard_normal(samples.size)
    return Record(t_s[samples], DRIVE_V * drives[samples], POSITION_UM * shown)
