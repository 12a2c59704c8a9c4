"""The voltage at which a stage is taken over if the read-back and the last write differ. Pure.

Two voltages are credible: the read-back, and the voltage that was written last. The read-back is
taken if the amplifier itself reports that the last write is no longer in force. Otherwise the
sensor decides if its position is possible at only one of them, whatever the past of the stage.
"""

from collections.abc import Callable, Sequence
from math import isfinite, nan
from typing import NamedTuple

from piezod.config.faults import Fault
from piezod.control.faults.register import FaultRegister
from piezod.control.stage.axis import StageAxis
from piezod.control.stage.zeroing import SensorZero
from piezod.control.watch.axis import AxisWatch
from piezod.telemetry.record import StageEvent

_WRONG_POSITION = (Fault.S1, Fault.S9, Fault.S10, Fault.S13)
"""Faults of a sensor whose samples are valid and nevertheless prove nothing."""


class Claim(NamedTuple):
    """A voltage that may be in force.

    Attributes:
        drive_v: The voltage, in V; NaN if there is none.
        low_um: Lowest position that a stage can have at this voltage, in µm; NaN without a model.
        high_um: Highest such position, in µm.
    """

    drive_v: float
    low_um: float = nan
    high_um: float = nan

    def excludes(self, position_um: float) -> bool:
        """Return whether the stage cannot be at a position; False if either is unknown."""
        return position_um < self.low_um or position_um > self.high_um

    def __str__(self) -> str:
        """Return the voltage and its positions, for people."""
        positions = f" (allows {self.low_um:.4g} to {self.high_um:.4g} µm)"
        return f"{self.drive_v:.4g} V{positions if isfinite(self.low_um) else ''}"


class Evidence(NamedTuple):
    """Everything that is known about the voltage in force on an axis.

    Attributes:
        read_back: The read-back.
        written: The voltage that was written last.
        position_um: Measured position, in µm; NaN if it proves nothing.
        fall_explained: Whether the device was out of reach, or the loop stood still, so that a
            loss of power explains a read-back unlike the last write.
        reports_move: Whether the amplifier has reported since the last acknowledged write that its
            output fell, or that a person sets it.
    """

    read_back: Claim
    written: Claim
    position_um: float = nan
    fall_explained: bool = True
    reports_move: bool = False


class Takeover(NamedTuple):
    """The voltage at which an axis is taken over.

    Attributes:
        drive_v: The voltage, in V: the read-back or the last write.
        disagreement: The values that do not agree, and the reason of the choice; empty if they
            agree.
    """

    drive_v: float
    disagreement: str = ""


def take_over(known: Evidence, safe_v: float, tolerance_v: float) -> Takeover:
    """Return the voltage at which an axis is taken over. Real-time safe.

    Args:
        known: The evidence; its read-back is finite.
        safe_v: Safe voltage of the axis, in V.
        tolerance_v: Allowed difference between read-back and written voltage, in V.
    """
    read_back, written, position_um, fall_explained, reports_move = known
    if not abs(read_back.drive_v - written.drive_v) > tolerance_v:  # also without a last write
        contradicted = read_back.excludes(position_um)
        why = "there is no other voltage to start from"
        return Takeover(read_back.drive_v, _disagreement(known, why) if contradicted else "")
    if reports_move:
        why = "the read-back, because the amplifier reports that its output has changed"
        return Takeover(read_back.drive_v, _disagreement(known, why))
    if read_back.excludes(position_um) != written.excludes(position_um):
        chosen = written if read_back.excludes(position_um) else read_back
        why = f"the sensor allows {chosen.drive_v:.4g} V only"
    elif fall_explained:
        # A step up from an output that has lost its power would be the worst that can happen.
        chosen, why = read_back, "the read-back, because the output may have lost its power"
    else:
        chosen = max(read_back, written, key=lambda claim: abs(claim.drive_v - safe_v))
        why = f"the voltage farther from the safe voltage, {safe_v:g} V"
    return Takeover(chosen.drive_v, _disagreement(known, why))


class OutputJudge:
    """Judges which voltages are in force, and reports evidence that disagrees. Real-time safe.

    Args:
        axes: The axes of the stage.
        watches: Their watches.
        register: The faults of the stage.
        zero: The zeros of its sensors.
        note: Takes the reports.
    """

    def __init__(
        self,
        axes: Sequence[StageAxis],
        watches: Sequence[AxisWatch],
        register: FaultRegister,
        zero: SensorZero,
        note: Callable[[StageEvent], None],
    ) -> None:
        self._axes, self._watches, self._register = axes, watches, register
        self._zero, self._note = zero, note

    def resync(self, read_back_v: Sequence[float], written_v: Sequence[float], t_ns: int) -> None:
        """Take over the outputs of lost amplifiers that answer again.

        Args:
            read_back_v: Read-back of each axis, finite, in V.
            written_v: Voltage of each axis that was written last, in V; NaN if none was.
            t_ns: Instant of the cycle, in ns.
        """
        for i, axis in enumerate(self._axes):
            amplifier = self._watches[i].amplifier
            known = self._evidence(i, read_back_v[i], written_v[i])._replace(
                fall_explained=not amplifier.unexplained_fall, reports_move=amplifier.reports_move
            )
            axis.track(self._resolve(i, known, t_ns))

    def starts_at_read_back(self, index: int, t_ns: int) -> bool:
        """Track an output that has just fallen, if the sensor shows it too; return whether it does.

        A read-back farther from the safe voltage is ignored: no ramp may start with a step away
        from it, and a single read-back may be wrong.
        """
        axis, read_back_v = self._axes[index], self._watches[index].amplifier.unexpected_v
        safe_v, in_force_v = axis.config.safe_v, axis.law.in_force_v
        if not abs(read_back_v - safe_v) < abs(in_force_v - safe_v):  # also without a read-back
            return False
        known = self._evidence(index, read_back_v, in_force_v)._replace(fall_explained=False)
        start_v = self._resolve(index, known, t_ns)
        if start_v == in_force_v:
            return False
        axis.track(start_v)
        return True

    def doubt(self) -> str:
        """Return why a voltage to be armed at cannot be in force; empty if nothing contradicts it.

        A sensor that was never zeroed contradicts nothing.
        """
        for i, axis in enumerate(self._axes):
            claim, position_um = self._claim(i, axis.law.in_force_v), self._position_um(i)
            if self._zero.um(i) != 0.0 and claim.excludes(position_um):
                return (
                    f"axis {axis.name}: the voltage in force should be {claim}, but the sensor "
                    f"shows {position_um:.4g} µm: check the read-back of the amplifier; if it is "
                    f"right, bring the output to the rest voltage and `piezod zero`"
                )
        return ""

    def _claim(self, index: int, drive_v: float) -> Claim:
        return Claim(drive_v, *self._watches[index].sensor.allowed_um(drive_v))

    def _position_um(self, index: int) -> float:
        """Return the position of an axis, in µm; NaN if it proves nothing."""
        sample = self._watches[index].sensor.sample
        doubtful = any(self._register.axes_of(fault) >> index & 1 for fault in _WRONG_POSITION)
        return sample.position_um if sample.valid and not doubtful else nan

    def _evidence(self, index: int, read_back_v: float, written_v: float) -> Evidence:
        read_back, written = self._claim(index, read_back_v), self._claim(index, written_v)
        return Evidence(read_back, written, self._position_um(index))

    def _resolve(self, index: int, known: Evidence, t_ns: int) -> float:
        """Return the voltage in force, in V; report if read-back, write and sensor disagree."""
        axis = self._axes[index]
        tolerance_v = axis.law.limits.read_back_tolerance_v
        drive_v, disagreement = take_over(known, axis.config.safe_v, tolerance_v)
        if disagreement:
            self._note(StageEvent(t_ns, "warning", "output", disagreement, axis=axis.name))
        return drive_v


def _disagreement(known: Evidence, why: str) -> str:
    written = f", last write {known.written}" if isfinite(known.written.drive_v) else ""
    sensor = "no sensor to ask"
    if isfinite(known.position_um):
        sensor = f"sensor {known.position_um:.4g} µm"
    return f"read-back {known.read_back}{written} and {sensor} do not agree: {why}"
