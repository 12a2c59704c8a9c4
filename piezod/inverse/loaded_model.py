"""A model file as an object: voltages for positions, positions for voltages."""

from collections.abc import Mapping
from math import inf, nan
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from piezod.config.axes import AxisConfig
from piezod.config.model_file import ModelFile
from piezod.config.waveforms.paths import Csv
from piezod.control.guard import Limits
from piezod.control.law.compensated import in_loop, limits_of, shaper_of, stage_delay_of
from piezod.control.law.dynamics import known_dynamics
from piezod.control.law.model import REST_BEYOND, StageModel, with_found_mode
from piezod.control.law.model_files import read_model
from piezod.control.reference.preview import ReferenceShaper
from piezod.errors import DataError
from piezod.hysteresis.memory import FloatArray
from piezod.inverse.feedforward import Feedforward
from piezod.units import NS_PER_S, s_to_ns

_EVEN = 1.25
"""A longest step of so many median steps is no even rate."""


class Uncertainty(NamedTuple):
    """Errors of the model on the record that it was fitted to; NaN if the file does not say."""

    voltage_max_v: float  #: Worst error of a voltage that it gives for a measured position, in V.
    voltage_rms_v: float  #: Rms error of the same, in V.
    position_max_um: float  #: Worst error of a position that it gives for a voltage, in µm.
    position_rms_um: float  #: Rms error of the same, in µm.


class Plan(NamedTuple):
    """Voltages for a trajectory; all arrays have the shape (n,)."""

    t_s: FloatArray  #: Instants from which the voltages hold, in s; the first is that given.
    drive_v: FloatArray  #: Voltages, in V.
    position_um: FloatArray  #: Positions of the trajectory at these instants, in µm.
    predicted_um: FloatArray  #: Positions that the model predicts at these instants, in µm.
    slew_v_per_s: FloatArray  #: Change to each voltage from the one before, in V/s.
    limited: npt.NDArray[np.str_]  #: What cut each voltage: `none`, `range` or `slew rate`.
    merged_pairs: int  #: Pairs of turning points that a full memory has removed.


class LoadedModel:
    """An identified model of a stage, from `piezod.load_model`. Units are V, µm and s.

    Positions count from rest, as in the loop. `voltages`, `plan` and `positions` each start anew;
    `step` and `reset` go on from step to step. Not real-time safe, except for `step`.

    Args:
        file: Contents of the model file.
        model: The model in it.
        axis: Configuration of the axis, for its limits, rest, modes and delays; None for the
            limits of the model alone, without a limit of the slew rate.
        rate_hz: Rate of `step`, in Hz.
    """

    units: ClassVar[Mapping[str, str]] = {"drive": "V", "position": "µm", "time": "s"}

    def __init__(
        self, file: ModelFile, model: StageModel, axis: AxisConfig | None, rate_hz: float
    ) -> None:
        self.file = file
        """Contents of the model file."""
        self.rate_hz = rate_hz
        """Rate of `step`, in Hz."""
        self._axis = axis and with_found_mode(axis, model)
        low_v, high_v = model.drive_v
        if axis is None:
            holds_at_0 = -REST_BEYOND <= model.drive_v.to_unit(0.0) <= 1.0 + REST_BEYOND
            self.rest_v = 0.0 if holds_at_0 else low_v
            """Voltage at rest, where positions count from, in V."""
            self.limits = Limits(low_v, high_v, inf)
            """Limits of the voltages, in V and V/s."""
        else:
            self.rest_v, self.limits = axis.limits.rest_v, limits_of(axis)
        self._model = model.zeroed_at(self.rest_v)
        self._stepping = self._law(self.model_at(rate_hz), s_to_ns(1.0 / rate_hz), None, None)

    def __repr__(self) -> str:
        """Return kind and ranges."""
        (low_v, high_v), (low_um, high_um) = self.drive_range_v, self.position_range_um
        return (
            f"<piezod model: {self.file.operators}, {low_v:.4g} to {high_v:.4g} V, "
            f"{low_um:.4g} to {high_um:.4g} µm>"
        )

    @property
    def drive_range_v(self) -> tuple[float, float]:
        """Lowest and highest voltage for which the model holds, in V."""
        low_v, high_v = self._model.drive_v
        return low_v, high_v

    @property
    def position_range_um(self) -> tuple[float, float]:
        """Lowest and highest position that it can reach within the limits, in µm."""
        return self._model.reach_um(self.limits.drive_min_v, self.limits.drive_max_v)

    @property
    def uncertainty(self) -> Uncertainty:
        """Errors of the model on the record that it was fitted to."""
        fit, (drive_v, position_um) = self.file.fit, (self._model.drive_v, self._model.position_um)
        pct = fit.position_error_max_pct, fit.position_error_rms_pct
        max_pct, rms_pct = (nan if each is None else each for each in pct)
        return Uncertainty(
            fit.voltage_error_max_pct / 100.0 * drive_v.width,
            fit.voltage_error_rms_pct / 100.0 * drive_v.width,
            max_pct / 100.0 * position_um.width,
            rms_pct / 100.0 * position_um.width,
        )

    def lookahead_s(self, rate_hz: float) -> float:
        """Return how long after its instant a voltage shows, in s: one period and the delay."""
        period_ns = s_to_ns(1.0 / rate_hz)
        period_s, model = period_ns / NS_PER_S, self.model_at(rate_hz)
        delay_s = stage_delay_of(self._axis, model, period_s) if self._axis else model.delay_s
        return (period_ns + s_to_ns(delay_s)) / NS_PER_S

    def model_at(self, rate_hz: float) -> StageModel:
        """Return the model for a loop at a rate, in Hz, with its zero at rest."""
        period_s = s_to_ns(1.0 / rate_hz) / NS_PER_S
        if self._axis is None:
            return self._model.at(period_s)
        return in_loop(self._axis, self._model, known_dynamics(self._axis, period_s), period_s)

    def reset(self, from_v: float | None = None, after_v: npt.ArrayLike | None = None) -> None:
        """Start `step` anew; arguments as for `voltages`."""
        period_ns = s_to_ns(1.0 / self.rate_hz)
        self._stepping = self._law(self.model_at(self.rate_hz), period_ns, from_v, after_v)

    def step(self, position_um: float) -> float:
        """Return the voltage for the next position, in V. Real-time safe.

        It shows `lookahead_s` later, so give the position of that instant. No corner is rounded.

        Args:
            position_um: Position, in µm; one out of reach counts as the nearest, NaN as the last.
        """
        return self._stepping.step(position_um)

    def voltages(
        self,
        t_s: npt.ArrayLike,
        position_um: npt.ArrayLike,
        *,
        rate_hz: float | None = None,
        from_v: float | None = None,
        after_v: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the voltages with which the stage follows a trajectory, in V, shape (n,).

        They are those that mode `feedforward` of the loop would write, to the last bit: they come
        early by the delay, and known modes are not rung. Row k holds from `k / rate_hz` on.

        Args:
            t_s: (m,) times, in s; they increase.
            position_um: (m,) positions at these times, in µm, joined by straight lines.
            rate_hz: Rate of the voltages, in Hz; None for that of an even trajectory.
            from_v: Voltage at which the stage has stood for long, after a move from rest, in V;
                None for a start at rest.
            after_v: (l,) voltages that were applied just before, in V, at the same rate.

        Raises:
            DataError: If the trajectory is not finite, not in order, or without an even rate.
        """
        return self.plan(t_s, position_um, rate_hz=rate_hz, from_v=from_v, after_v=after_v).drive_v

    def plan(
        self,
        t_s: npt.ArrayLike,
        position_um: npt.ArrayLike,
        *,
        rate_hz: float | None = None,
        from_v: float | None = None,
        after_v: npt.ArrayLike | None = None,
    ) -> Plan:
        """Return `voltages` with predicted positions, slew rates, and what the limits cut."""
        times_s, positions_um = checked_trajectory(t_s, position_um)
        rate_hz = rate_hz or even_rate_hz(times_s)
        model, period_ns = self.model_at(rate_hz), s_to_ns(1.0 / rate_hz)
        lookahead_s, law = self.lookahead_s(rate_hz), self._law(model, period_ns, from_v, after_v)
        since_s = times_s - times_s[0]
        packed = {"times_s": since_s.tobytes(), "levels": positions_um.tobytes()}
        reference = Csv.unpacked({**packed, "span": (nan, nan)}).value
        shaped = self._shaper(period_ns / NS_PER_S).shape(reference, moving=False)
        rows = int(since_s[-1] * NS_PER_S / period_ns + 1e-6) + 1
        at_s = np.arange(rows, dtype=np.int64) * period_ns / NS_PER_S
        drive_v, shown_um, limited = np.empty(rows), np.empty(rows), []
        before_v, before_um = law.in_force_v, law.expected_um
        for k, each_s in enumerate(at_s.tolist()):
            drive_v[k] = law.step(shaped.value(each_s + lookahead_s))
            shown_um[k] = law.expected_um
            limited.append(law.limited.value)
        return Plan(
            times_s[0] + at_s,
            drive_v,
            np.array([reference(each_s) for each_s in at_s.tolist()]),
            np.interp(at_s - lookahead_s, at_s, shown_um, left=before_um),
            np.diff(drive_v, prepend=before_v) * (NS_PER_S / period_ns),
            np.array(limited),
            law.merged_pairs,
        )

    def positions(
        self,
        t_s: npt.ArrayLike,
        drive_v: npt.ArrayLike,
        *,
        from_v: float | None = None,
    ) -> FloatArray:
        """Return the positions to which voltages lead, in µm, shape (n,), at their instants.

        Args:
            t_s: (n,) times, in s, evenly spaced.
            drive_v: (n,) voltages that hold from these times on, in V; the limits apply.
            from_v: As for `voltages`.

        Raises:
            DataError: If the record is not finite, not in order, or without an even rate.
        """
        times_s, drives_v = checked_trajectory(t_s, drive_v)
        rate_hz = even_rate_hz(times_s)
        law = self._law(self.model_at(rate_hz), s_to_ns(1.0 / rate_hz), from_v, None)
        before_um, shown_um = law.expected_um, np.empty(drives_v.size)
        for k, each_v in enumerate(drives_v.tolist()):
            law.force(each_v)
            shown_um[k] = law.expected_um
        return np.interp(times_s - self.lookahead_s(rate_hz), times_s, shown_um, left=before_um)

    def _law(
        self,
        model: StageModel,
        period_ns: int,
        from_v: float | None,
        after_v: npt.ArrayLike | None,
    ) -> Feedforward:
        low_v, high_v = self.limits.drive_min_v, self.limits.drive_max_v
        if from_v is not None and not low_v <= from_v <= high_v:
            message = f"from_v is {from_v:g} V, allowed are {low_v:g} to {high_v:g} V"
            raise DataError(message)
        law = Feedforward(model, self.limits, period_ns / NS_PER_S, self.rest_v, from_v)
        for each_v in [] if after_v is None else np.asarray(after_v, dtype=np.float64).tolist():
            law.force(each_v)
        return law

    def _shaper(self, period_s: float) -> ReferenceShaper:
        if self._axis is None:
            mode = self._model.mode
            return ReferenceShaper(period_s, mode.frequency_hz if mode else None)
        return shaper_of(self._axis, known_dynamics(self._axis, period_s), period_s)


def load_model(
    path: str | Path, *, rate_hz: float | None = None, axis: AxisConfig | None = None
) -> LoadedModel:
    """Return the model in a model file, relaxed at rest.

    Args:
        path: The file, as `piezod identify --out` writes it.
        rate_hz: Rate of `step`, in Hz; None for that of the identification.
        axis: Configuration of its axis; None for the model alone.

    Raises:
        ConfigError: If the file is no model file, or if its model cannot be used.
        DataError: If the model does not hold at rest, or the rate is needed.
    """
    model, file = read_model(Path(path))
    if rate_hz is None:
        rate_hz = 1.0 / file.held_s if file.held_s else 1000.0
    if not 0.0 < rate_hz < inf:
        raise DataError(f"rate_hz is {rate_hz:g}, allowed are rates above 0 Hz")
    return LoadedModel(file, model, axis, rate_hz)


def checked_trajectory(t_s: npt.ArrayLike, values: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return times and values as arrays of shape (n,).

    Raises:
        DataError: If they differ in number, are fewer than two or not finite, or if times do not
            increase.
    """
    times_s = np.ascontiguousarray(t_s, dtype=np.float64)
    series = np.ascontiguousarray(values, dtype=np.float64)
    if times_s.ndim != 1 or times_s.shape != series.shape or times_s.size < 2:
        message = f"need two or more values, one for each time, got {series.shape}"
        raise DataError(f"{message} for times of {times_s.shape}")
    for name, each in (("t_s", times_s), ("the values", series)):
        bad = np.flatnonzero(~np.isfinite(each))
        if bad.size:
            raise DataError(f"{name}: row {bad[0] + 1} is {each[bad[0]]}; allowed are numbers")
    back = np.flatnonzero(np.diff(times_s) <= 0.0)
    if back.size:
        raise DataError(f"t_s: row {back[0] + 2} is not later than the row before; sort the rows")
    return times_s, series


def even_rate_hz(times_s: FloatArray) -> float:
    """Return the rate of evenly spaced times, in Hz.

    Raises:
        DataError: If they are not even.
    """
    steps_s = np.diff(times_s)
    median_s = float(np.median(steps_s))
    if float(np.max(steps_s)) > _EVEN * median_s:
        message = f"the times are {np.min(steps_s):.4g} to {np.max(steps_s):.4g} s apart"
        raise DataError(f"{message}: give the rate of the voltages, in Hz (rate_hz, --loop-hz)")
    # The mean is exact for times that were rounded.
    return (times_s.size - 1) / float(times_s[-1] - times_s[0])
