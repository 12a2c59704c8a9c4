"""What a stage carries from run to run: its creep, and what relaxes along the path of its drive."""

import numpy as np

from piezod.control.law.creep import CreepState
from piezod.control.law.model import StageModel
from piezod.hysteresis import SurfaceForm
from piezod.hysteresis.creep import remove_creep
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.path_relaxation import RELAXED_PATH
from piezod.hysteresis.surface_form import SurfaceStage


class Creeping:
    """The creep of one axis, from its measured positions, and its path, from its voltages.

    Args:
        model: Model of the axis, with its zero at rest.
        period_s: Sample period, in s.
    """

    def __init__(self, model: StageModel, period_s: float) -> None:
        self._position_um = model.position_um
        self._creep = model.creep.at(period_s)
        self._rest = self._quick = model.position_um.to_unit(0.0)
        self._lags = np.full(model.creep.weights.size, self._rest)
        self._zeroed = 0.0
        self._drive_v = model.drive_v
        self._path: SurfaceStage | None = None
        form = model.form
        if isinstance(form, SurfaceForm) and form.path:
            self._path = form.sampled(period_s).stage(model.weights)
            self._rest_drive = form.slow.drives_at(model.weights, np.array([self._rest])).item()
        self.zero()

    def watch(self, position_um: FloatArray) -> None:
        """Follow measured positions, shape (n,), in µm; NaN for missing samples."""
        known = np.flatnonzero(np.isfinite(position_um))
        if not self._lags.size or not known.size:
            return
        # A missing sample counts as the last one before it; the first ones count as the first
        # sample.
        held = np.maximum.accumulate(
            np.where(np.isfinite(position_um), np.arange(position_um.size), known[0])
        )
        x = self._position_um.to_unit(position_um[held]) + self._zeroed
        self._quick = float(remove_creep(self._creep, x, self._lags, self._quick)[-1])

    def follow(self, drive_v: FloatArray) -> None:
        """Follow voltages in force, shape (n,), in V."""
        if self._path:
            for drive in self._drive_v.to_unit(drive_v).tolist():
                self._path.step(drive)

    def zero(self) -> None:
        """Take the present displacement as zero: the stage rests, and its sensor was zeroed."""
        left = 0.0
        if self._path:
            self._path.step(self._rest_drive)
            left = self._path.relaxing
        self._quick = self._rest + left
        self._zeroed = float(self._creep.weights @ self._lags) + left

    @property
    def state(self) -> CreepState:
        """Present state of creep and path."""
        path = self._path.path if self._path else RELAXED_PATH
        return CreepState(self._creep, self._lags, self._zeroed, self._quick, path)
