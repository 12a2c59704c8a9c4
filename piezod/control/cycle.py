"""One cycle of the loop: read, judge, compensate, guard, write. Time is an argument."""

from collections.abc import Container, Sequence
from typing import NamedTuple, Protocol

from piezod.control.guard import Admitted, Guard
from piezod.control.law.axis import Axis, AxisOutput
from piezod.devices.interface import Sample
from piezod.units import NS_PER_S


class CycleRecord(NamedTuple):
    """What happened in one cycle; per axis, in the order of the axes.

    Attributes:
        t_ns: Instant of the cycle.
        samples: Measured displacements, as they were used.
        outputs: What the axes asked for.
        admitted: What the guard let through.
        written: Whether the amplifier took the voltages.
    """

    t_ns: int
    samples: Sequence[Sample]
    outputs: Sequence[AxisOutput]
    admitted: Admitted
    written: bool


class Senses(Protocol):
    """What the cycle needs of a sensor."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take one sample of each axis; may be called in the loop."""
        ...


class Drives(Protocol):
    """What the cycle needs of an amplifier."""

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set the voltage of every axis; return whether it was taken; call it in the loop."""
        ...


class Overseer(Protocol):
    """Whoever decides, between reading and compensating, what is true and what is done."""

    @property
    def sent_v(self) -> Sequence[float] | None:
        """What was sent last and not acknowledged, in V; None where nothing was."""
        ...

    @property
    def eased(self) -> Container[int]:
        """Axes that may go only half as fast as usual."""
        ...

    def watch(self, t_ns: int, samples: Sequence[Sample]) -> Sequence[Sample]:
        """Return the samples that may be used; may be called in the loop."""
        ...


class Unwatched:
    """Nobody: samples are used as they are."""

    sent_v: Sequence[float] | None = None
    eased: Container[int] = ()

    def watch(self, t_ns: int, samples: Sequence[Sample]) -> Sequence[Sample]:  # noqa: ARG002
        """Return the samples; may be called in the loop."""
        return samples


class Cycle:
    """The way of a sample, for all axes in one transaction.

    Args:
        sensor: Gives one sample per axis.
        amplifier: Takes one voltage per axis.
        axes: The axes, in the devices' order; whoever owns the list may exchange them.
        guard: The last thing before the write.
        period_s: Period of the loop, in s.
        overseer: Who judges the samples.
    """

    def __init__(
        self,
        sensor: Senses,
        amplifier: Drives,
        axes: Sequence[Axis],
        guard: Guard,
        period_s: float,
        overseer: Overseer | None = None,
    ) -> None:
        self._sensor, self._amplifier, self._axes = sensor, amplifier, axes
        self._guard, self._period_s = guard, period_s
        self._overseer = overseer or Unwatched()
        self._written_ns: int | None = None

    def run(self, t_ns: int) -> CycleRecord:
        """Run one cycle; may be called in the loop; a fault is a value in the record."""
        samples = self._overseer.watch(t_ns, self._sensor.read(t_ns))
        outputs = [
            axis.update(t_ns, sample) for axis, sample in zip(self._axes, samples, strict=True)
        ]
        asked_v = [output.drive_v for output in outputs]
        in_force_v = [output.in_force_v for output in outputs]
        planned_t_ns = min(output.t_ns for output in outputs)
        elapsed_s, sent_v = self._elapsed_s(t_ns), self._overseer.sent_v
        eased = self._overseer.eased
        admitted = self._guard.admit(
            planned_t_ns, t_ns, asked_v, in_force_v, elapsed_s, sent_v, eased
        )
        written = admitted.writable and self._amplifier.write(admitted.drive_v, t_ns)
        if written:
            self._written_ns = t_ns
            for axis, drive_v in zip(self._axes, admitted.drive_v, strict=True):
                axis.applied(drive_v)
        return CycleRecord(t_ns, samples, outputs, admitted, written)

    def _elapsed_s(self, t_ns: int) -> float:
        """Return how long the drive may have moved: less than a period after a late cycle."""
        if self._written_ns is None:
            return self._period_s
        return min((t_ns - self._written_ns) / NS_PER_S, self._period_s)
