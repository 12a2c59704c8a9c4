"""One cycle of the loop: read, identify, compensate, limit, write. Time is an argument."""

from collections.abc import Sequence
from typing import NamedTuple

from piezod.control.axis import Axis, AxisOutput
from piezod.devices.interface import Amplifier, Sample, Sensor


class CycleRecord(NamedTuple):
    """What happened in one cycle; per axis, in the order of the axes.

    Attributes:
        t_ns: Instant of the cycle.
        samples: Measured displacements.
        outputs: What the axes asked for.
        written: Whether the amplifier took the voltages.
    """

    t_ns: int
    samples: Sequence[Sample]
    outputs: Sequence[AxisOutput]
    written: bool


class Cycle:
    """The way of a sample, for all axes in one transaction.

    Args:
        sensor: Gives one sample per axis.
        amplifier: Takes one voltage per axis.
        axes: The axes, in the devices' order.
    """

    def __init__(self, sensor: Sensor, amplifier: Amplifier, axes: Sequence[Axis]) -> None:
        self._sensor, self._amplifier, self._axes = sensor, amplifier, axes

    def run(self, t_ns: int) -> CycleRecord:
        """Run one cycle; may be called in the loop; a fault is a value in the record."""
        samples = self._sensor.read(t_ns)
        outputs = [
            axis.update(t_ns, sample) for axis, sample in zip(self._axes, samples, strict=True)
        ]
        written = self._amplifier.write([output.drive_v for output in outputs], t_ns)
        if written:
            for axis, output in zip(self._axes, outputs, strict=True):
                axis.applied(output.drive_v)
        return CycleRecord(t_ns, samples, outputs, written)
