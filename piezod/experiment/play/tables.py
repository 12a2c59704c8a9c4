"""From a wanted displacement to a table of voltages, by the inverse model.

Hysteresis depends on the past. So the lead-in of each table goes through the whole range of the
model, up and down, which leaves the same memory of turns after any past. Then the waveform fades in
without exciting a mode, and goes on until the memory is periodic.

What relaxes along the path is nearer to its rest after that swing, but not there if it relaxes
slowly. `TableMaker.conditioning` brings it there, once, before the first waveform.
"""

from itertools import pairwise

import numpy as np

from piezod.control.law.model import StageModel
from piezod.devices.played_axis import AxisTable
from piezod.errors import DataError
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S

SWING_S = 0.1
"""Duration of each half of the conditioning swing, in s."""
FADE_S = 0.1
"""Shortest time in which a waveform fades in, in s."""
SLEW_SHARE = 0.5
"""Share of the slew limit that the conditioning swing may use."""
BEYOND = 0.1
"""Share of its range by which a corrected command may leave that of the model. Where no voltage
reaches it, the voltage stays at its end: a model that is wrong by some per cent asks for more than
the stage needs."""
_PERIODIC = 1e-6  # of the range of the drive
_MOST_PERIODS = 8


class TableMaker:
    """Makes tables for one axis."""

    def __init__(
        self,
        model: StageModel,
        interval_ns: int,
        limits_v: tuple[float, float],
        slew_v_per_s: float,
    ) -> None:
        self._model, self._interval_ns = model, interval_ns
        self._form = model.form.sampled(interval_ns / NS_PER_S)
        # The range of a model may exceed the limits by some rounding of the record.
        self._limits_v = limits_v
        self._low_v, self._high_v = np.clip(model.drive_v, *limits_v).tolist()
        width_v = self._high_v - self._low_v
        # The largest slope of a raised cosine is π/2 times its mean slope.
        slowest_s = 0.5 * np.pi * width_v / (SLEW_SHARE * slew_v_per_s)
        self._swing = self._points(max(SWING_S, slowest_s))
        self._fade_s = max(FADE_S, slowest_s)

    def table(self, wanted_um: FloatArray, in_force_v: float, cycles: int) -> AxisTable:
        """Return the table for one period of displacement.

        Args:
            wanted_um: (n,) displacement without creep and dynamics, in µm.
            in_force_v: Voltage in force, at which the lead-in begins, in V.
            cycles: Number of periods.

        Raises:
            DataError: If the displacement leaves the range of the model.
        """
        wanted = self._checked(wanted_um)
        fade_in, period_v = self._inverse(wanted)
        lead_in_v = np.concatenate((self._swing_from(in_force_v), fade_in))
        return AxisTable(self._interval_ns, lead_in_v, period_v, cycles)

    def _swing_from(self, in_force_v: float) -> FloatArray:
        """Return a swing from the voltage in force through the whole range."""
        # Noise of the read-back may be beyond a limit; the guard refuses a true difference.
        begin_v = min(max(in_force_v, self._limits_v[0]), self._limits_v[1])
        up = _raised_cosine(begin_v, self._high_v, self._swing)
        return np.concatenate((up, _raised_cosine(self._high_v, self._low_v, self._swing)))

    def levels(self, wanted_um: FloatArray, in_force_v: float) -> tuple[FloatArray, FloatArray]:
        """Return the voltages of a lead-in to the first of some levels, and those of the levels.

        Args:
            wanted_um: (n,) displacements without creep and dynamics, one after the other, in µm.
            in_force_v: Voltage in force, at which the lead-in begins, in V.

        Raises:
            DataError: If a level leaves the range of the model.
        """
        wanted = self._checked(wanted_um)
        rise = self._points(self._fade_s)
        faded = wanted[0] * _raised_cosine(0.0, 1.0, rise)
        drives = self._form.drives_at(self._model.weights, np.concatenate((faded, wanted)))
        voltages = self._model.drive_v.from_unit(drives)
        voltages = np.clip(voltages, self._low_v, self._high_v)
        lead_in_v = np.concatenate((self._swing_from(in_force_v), voltages[:rise]))
        return lead_in_v, voltages[rise:]

    @property
    def v_per_um(self) -> float:
        """Mean voltage per displacement, in V/µm."""
        return float(self._high_v - self._low_v) / self._model.position_um.width

    def conditioning(self, rest_v: float) -> AxisTable | None:
        """Return swings from rest through the whole range and back; None if none is needed."""
        cycles = max(self._form.cycles_to_rest, self._model.rests_inside(rest_v))
        if not cycles:
            return None
        ends_v = (rest_v, self._high_v, self._low_v, rest_v)
        swings = [_raised_cosine(*ends, self._swing) for ends in pairwise(ends_v)]
        return AxisTable(self._interval_ns, np.empty(0), np.concatenate(swings), cycles)

    def _inverse(self, wanted: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the voltages that fade in, and those of one period, for periodic displacement."""
        n = wanted.size
        periods = max(1, -(-self._points(self._fade_s) // n))
        faded = np.tile(wanted, periods) * _raised_cosine(0.0, 1.0, periods * n)
        before = np.empty(0)
        for count in range(2, _MOST_PERIODS + 1):
            positions = np.concatenate((faded, np.tile(wanted, count)))
            drives = self._form.drives_at(self._model.weights, positions)
            before, last = drives[-2 * n : -n], drives[-n:]
            if np.max(np.abs(last - before)) < _PERIODIC:
                break
        voltages = self._model.drive_v.from_unit(drives)
        voltages = np.clip(voltages, self._low_v, self._high_v)
        # The periods before the last one belong to the lead-in: there the memory becomes periodic.
        return voltages[:-n], voltages[-n:]

    def check(self, command_um: FloatArray) -> None:
        """Refuse a command that leaves the range of the model.

        Args:
            command_um: (n,) displacement, in µm.

        Raises:
            DataError: If it does.
        """
        self._require("command", command_um, 0.0)

    def _checked(self, wanted_um: FloatArray) -> FloatArray:
        """Return a displacement in the unit of the model, or the nearest that it may have."""
        self._require("corrected command", wanted_um, BEYOND)
        return self._form.reachable(self._model.position_um.to_unit(wanted_um))

    def _require(self, what: str, values_um: FloatArray, beyond: float) -> None:
        low_um, high_um = self._model.position_um
        more_um = beyond * (high_um - low_um)
        inside = (values_um >= low_um - more_um) & (values_um <= high_um + more_um)
        outside = np.flatnonzero(~inside)  # NaN is outside
        if outside.size:
            k = int(outside[np.argmax(np.abs(values_um[outside] - (low_um + high_um) / 2.0))])
            allowed = f", allowed: up to {more_um:.4g} µm beyond" if beyond else ""
            raise DataError(
                f"the {what} is {values_um[k]:.4g} µm at point {k} of the period, but "
                f"the model holds from {low_um:.4g} to {high_um:.4g} µm{allowed}; reduce the "
                "command, or identify the axis with a record of such motions"
            )

    def _points(self, duration_s: float) -> int:
        return max(1, round(duration_s * NS_PER_S / self._interval_ns))


def _raised_cosine(begin: float, end: float, points: int) -> FloatArray:
    """Return values from one level to another that begin and end without a slope."""
    turns = np.arange(points) / points
    return begin + (end - begin) * (0.5 - 0.5 * np.cos(np.pi * turns))
