"""Judges the voltage on the stage: how far a write may be from it.

A write is judged by the output as it is just before, whatever the output does with the write. So a
write to an output that is stuck counts as the step that it makes when the output is released.

Three witnesses tell where the output is: its read-back, the last write, and the sensor. Each may be
right, wrong or silent. A write is judged if they could tell:

- a right read-back tells, unless the last write and the sensor are both wrong;
- a silent one tells for as long as it is silent, and a last write that is right tells always;
- against a wrong one, the last write tells if it is right and the write follows it at once, or
  begins a movement, which could be refused; and the sensor tells if its position is possible at the
  output and not at the read-back.

Other writes are listed apart.
"""

from collections.abc import Sequence
from math import inf, isfinite, isnan, nan
from typing import Final

from piezod.config.states import State
from piezod.control.faults.table import FAULTS, FaultSource
from piezod.control.guard import Limits
from piezod.control.in_force import Claim
from piezod.control.stage.stage import Stage
from piezod.devices.interface import Identity
from piezod.testing.faulty import FaultyDevice, SensorAmplifier
from piezod.testing.injections import InjectionKind as Kind
from piezod.units import NS_PER_S
from tests.control.own_output import OwnOutput

MOST_VIOLATIONS: Final = 100
ROUNDING_V: Final = 1e-6
MOVES_V: Final = 0.01
"""An output that goes away from the last write by more than this has done so by itself."""
BELIEVES_CYCLES: Final = 20
"""After so many cycles a read-back counts that has left the last write by itself: A3 ramps then.
From then on the write approaches it at the slew rate."""
ARMED: Final = frozenset({State.READY, State.RUN, State.IDENT})
SENSOR_LIES: Final = frozenset(
    {
        *(Kind.STUCK, Kind.REPLACED, Kind.OFFSET, Kind.GAIN, Kind.NOISE, Kind.GARBAGE),
        *(Kind.LATE, Kind.DUPLICATE),
    }
)
"""Faults whose samples are valid and wrong."""
OF_SENSOR: Final = sum(1 << i for i, rule in enumerate(FAULTS) if rule.source is FaultSource.SENSOR)


class JudgedDevice(FaultyDevice):
    """A device of one axis with an output of its own, which may fail, and a judge."""

    def __init__(
        self, inner: SensorAmplifier, limits: Limits, period_ns: int, seed: int = 0
    ) -> None:
        self.output = OwnOutput(inner, (limits.drive_min_v, limits.drive_max_v))
        super().__init__(self.output, seed=seed)
        self.limits, self._tolerance_v = limits, limits.read_back_tolerance_v
        self._period_ns = period_ns
        self.bound_v = limits.slew_v_per_s * period_ns / NS_PER_S + self._tolerance_v
        """How far a write may be from the output if its read-back is of the same instant, in V."""
        self.stage: Stage | None = None
        """The stage that the loop runs; None without a loop, as for `piezod safe`."""
        self.violations: list[str] = []
        """Writes that were too far from the output; of those in a row, the first."""
        self._was_far = False
        self.largest_v = 0.0
        """Largest judged distance of a write from the output that did not move by itself, in V."""
        self.apart_v, self.apart = 0.0, 0
        """Largest distance of a write that nobody could judge, in V, and the number of those that
        were farther than the others may be."""
        self.near_v = inf
        """Smallest distance of a judged write from its bound, in V."""
        self.shown_v = nan
        """Last read-back, in V; NaN if it was silent."""
        self._shown_ns = self._right_ns = -1  # the last read-back, and the last right one
        self._own_v, self._wrote_ns = nan, -1  # by this process
        self._last_v = 0.0  # by any process
        self._lead_v = self._away_v = 0.0
        self._away_ns = 0

    def open(self) -> Identity:
        """Open the device for a process that knows of no write."""
        self.forget()
        return super().open()

    def forget(self) -> None:
        """Forget the last write, as a new process does."""
        self._own_v = nan

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the voltage in force, changed by the faults."""
        output_v = self.output.output_v(now_ns)
        values = super().read_back(now_ns)
        self.shown_v, self._shown_ns = values[0], now_ns
        if abs(self.shown_v - output_v) <= self._tolerance_v:
            self._right_ns = now_ns
        self._observe(output_v, now_ns)
        return values

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Write a voltage, and judge it if it is acknowledged."""
        output_v = self.output.output_v(now_ns)
        self._observe(output_v, now_ns)
        accepted = super().write(drive_v, now_ns)
        if accepted:
            self._judge(drive_v[0], output_v, now_ns)
            self._own_v = self._last_v = drive_v[0]
            self._lead_v, self._wrote_ns = abs(drive_v[0] - output_v), now_ns
        return accepted

    def judge_start(self, first_v: float, now_ns: int) -> None:
        """Judge the first point of a play, in V, as a write."""
        output_v = self.output.output_v(now_ns)
        self._observe(output_v, now_ns)
        self._judge(first_v, output_v, now_ns)

    def excludes(self, drive_v: float) -> bool:
        """Return whether the sensor is right and its position is not possible at a voltage."""
        if self.stage is None:
            return False
        sensor = self.stage.watches[0].sensor
        claim = Claim(drive_v, *sensor.allowed_um(drive_v))
        return sensor.sample.valid and claim.excludes(sensor.sample.position_um)

    def _observe(self, output_v: float, now_ns: int) -> None:
        """Note how far the output has gone from the last write by itself."""
        if not isnan(self.output.played_v):  # a table that piezod knows
            self._own_v = self._last_v = self.output.played_v
        lead_v = abs(self._last_v - output_v)
        if self.output.follows_by_gain or lead_v > self._lead_v + MOVES_V:
            self._away_v, self._away_ns = lead_v, now_ns
        elif not self._is_right:
            self._away_ns = now_ns
        self._away_v, self._lead_v = min(self._away_v, lead_v), lead_v

    @property
    def _is_right(self) -> bool:
        """Whether the last read-back was right."""
        return self._right_ns == self._shown_ns

    def _judge(self, drive_v: float, output_v: float, now_ns: int) -> None:
        distance_v = abs(drive_v - output_v)
        age_ns = self._told(output_v, now_ns)
        if age_ns is None:
            self.apart_v = max(self.apart_v, distance_v)
            self.apart += distance_v > self.bound_v
            return
        passed_ns = max(0, now_ns - self._away_ns - BELIEVES_CYCLES * self._period_ns)
        away_v = max(0.0, self._away_v - self.limits.slew_v_per_s * passed_ns / NS_PER_S)
        allowed_v = self.bound_v + self.limits.slew_v_per_s * age_ns / NS_PER_S + away_v
        self.near_v = min(self.near_v, allowed_v - distance_v)
        if self._away_v <= self._tolerance_v:
            self.largest_v = max(self.largest_v, distance_v)
        was_far, self._was_far = self._was_far, not distance_v <= allowed_v + ROUNDING_V
        if self._was_far and not was_far and len(self.violations) < MOST_VIOLATIONS:
            state = "no loop" if self.stage is None else self.stage.state
            self.violations.append(
                f"at {now_ns / NS_PER_S:.3f} s in {state}: {drive_v:.4g} V was written with "
                f"{output_v:.4g} V on the stage, allowed: {allowed_v:.4g} V away; read-back "
                f"{self.shown_v:.4g} V, last write {self._own_v:.4g} V; {self._faults(now_ns)}"
            )

    def _told(self, output_v: float, now_ns: int) -> int | None:
        """Return the age of the newest proof of the output, in ns; None if there is none."""
        own = abs(self._own_v - output_v) <= self._tolerance_v
        if self._is_right:
            return None if self._sensor_lies(now_ns) and not own else now_ns - self._right_ns
        if isnan(self.shown_v):
            return 0 if own else now_ns - self._right_ns
        follows = now_ns - self._wrote_ns < 3 * self._period_ns // 2
        sensor = self._sensor_tells(now_ns)
        begins = self.stage is not None and self.stage.state in ARMED
        if own and (follows or (begins and sensor)):
            return 0
        excluded = sensor and self.excludes(self.shown_v) and not self.excludes(output_v)
        # Beside a false read-back, the sensor allows an output at the last write: it is stuck.
        misled = not own and isfinite(self._own_v) and not self.excludes(self._own_v)
        return 0 if excluded and not misled else None

    def _sensor_lies(self, now_ns: int) -> bool:
        return any(one.kind in SENSOR_LIES for one in self._now(now_ns))

    def _sensor_tells(self, now_ns: int) -> bool:
        """Return whether the sensor is right, and the stage has no reason to distrust it."""
        if self.stage is None or not self.stage.watches[0].sensor.sample.valid:
            return False
        register = self.stage.register
        doubted = (register.present | register.latched) & OF_SENSOR
        return not (doubted or self._sensor_lies(now_ns))

    def _faults(self, now_ns: int) -> str:
        """Return the present faults of output and device, for people."""
        of_output = [one for one in self.output.faults if one.start_ns <= now_ns < one.end_ns]
        kinds = [*(one.kind for one in of_output), *(one.kind for one in self._now(now_ns))]
        return ", ".join(kinds) or "no fault present"
