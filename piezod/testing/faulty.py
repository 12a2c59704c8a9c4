"""A device that fails on schedule, around one that does not: for tests of what is done about it.

It is built by tests alone: no driver and no configuration can ask for it. Time is the `now_ns` of
the calls, so that a fault comes in the same cycle each time.
"""

from collections import deque
from collections.abc import Sequence
from math import nan
from random import Random
from typing import Final, Protocol

from piezod.devices.interface import Amplifier, Capabilities, Identity, KnowsTruth, Sample, Sensor
from piezod.devices.status import NO_FLAGS, Flags, TellsStatus
from piezod.testing.injections import Injection, InjectionKind

_REMEMBERED: Final = 4096  # samples, for late ones
_FLAGGED: Final = frozenset(
    {InjectionKind.FLAGGED, InjectionKind.SENSOR_FLAGGED, InjectionKind.LOST}
)


class FaultyError(Exception):
    """What a faulty driver raises; it is none of piezod's own errors, as that of a bad driver."""


class SensorAmplifier(Sensor, Amplifier, Protocol):
    """A device that is both."""


class FaultyDevice:
    """Implements `Sensor`, `Amplifier`, `KnowsTruth` and `TellsStatus` over another device.

    Args:
        inner: The device that works.
        schedule: When it does not; more may be added at any time.
        seed: Of noise and garbage.
    """

    def __init__(
        self, inner: SensorAmplifier, schedule: Sequence[Injection] = (), seed: int = 0
    ) -> None:
        self._inner = inner
        self.schedule = list(schedule)
        self._random = Random(seed)  # noqa: S311 - noise, no secret
        self._past: deque[Sequence[Sample]] = deque(maxlen=_REMEMBERED)
        self._frozen: dict[int, Sample] = {}
        self._drive_v: Sequence[float] = ()

    def open(self) -> Identity:
        """Open the device."""
        return self._inner.open()

    def capabilities(self) -> Capabilities:
        """Tell what the device can do."""
        return self._inner.capabilities()

    def activate(self, now_ns: int) -> None:
        """Activate the device."""
        self._inner.activate(now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Deactivate the device."""
        self._inner.deactivate(now_ns)

    def close(self) -> None:
        """Close the device."""
        self._inner.close()

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take samples, and spoil them.

        Raises:
            FaultyError: If that is the fault.
        """
        if self._any(InjectionKind.READ_RAISES, now_ns):
            raise FaultyError("the driver failed while it read")
        taken = list(self._inner.read(now_ns))
        self._past.append(tuple(taken))
        for one in self._now(now_ns):
            taken[one.axis] = self._spoilt(one, taken[one.axis], now_ns)
        for axis in set(self._frozen) - {one.axis for one in self._now(now_ns)}:
            del self._frozen[axis]
        return taken

    def true_position_um(self, now_ns: int) -> Sequence[float]:
        """Tell what the device knows, NaN where it knows nothing."""
        if isinstance(self._inner, KnowsTruth):
            return self._inner.true_position_um(now_ns)
        return [nan] * len(self.capabilities().inputs)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set the voltages, unless the fault is that this fails.

        Raises:
            FaultyError: If that is the fault.
        """
        if self._any(InjectionKind.WRITE_RAISES, now_ns):
            raise FaultyError("the driver failed while it wrote")
        if self._any(InjectionKind.REFUSED, now_ns) or self._any(InjectionKind.LOST, now_ns):
            return False
        sent_v = list(drive_v)
        for one in self._now(now_ns):
            if one.kind is InjectionKind.STUCK_OUTPUT and self._drive_v:
                sent_v[one.axis] = self._drive_v[one.axis]
        taken = self._inner.write(sent_v, now_ns)
        if taken:
            self._drive_v = sent_v
        return taken

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Tell the voltages in force, and spoil them."""
        told_v = list(self._inner.read_back(now_ns))
        for one in self._now(now_ns):
            if one.kind is InjectionKind.READ_BACK_OFFSET:
                told_v[one.axis] += one.value
            elif one.kind is InjectionKind.LOST:
                told_v[one.axis] = nan
        return told_v

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Tell what the device does, and the faults that show."""
        able = self.capabilities()
        n_inputs = len(able.inputs)
        if isinstance(self._inner, TellsStatus):
            told = list(self._inner.status(now_ns))
        else:
            told = [NO_FLAGS] * (n_inputs + len(able.outputs))
        for one in self._now(now_ns):
            if one.kind in _FLAGGED:
                told[one.axis] |= {one.flag}
            if one.kind in _FLAGGED - {InjectionKind.SENSOR_FLAGGED}:
                told[n_inputs + one.axis] |= {one.flag}
        return told

    def _now(self, now_ns: int) -> list[Injection]:
        return [one for one in self.schedule if one.start_ns <= now_ns < one.end_ns]

    def _any(self, kind: InjectionKind, now_ns: int) -> bool:
        return any(one.kind is kind for one in self._now(now_ns))

    def _spoilt(self, one: Injection, sample: Sample, now_ns: int) -> Sample:
        t_ns, position_um, valid = sample
        match one.kind:
            case InjectionKind.STUCK:
                position_um = self._frozen.setdefault(one.axis, sample).position_um
            case InjectionKind.DUPLICATE:
                return self._frozen.setdefault(one.axis, self._at(one.axis, now_ns - 1))
            case InjectionKind.LATE:
                return self._at(one.axis, now_ns - int(one.value))
            case InjectionKind.REPLACED:
                position_um = one.value
            case InjectionKind.OFFSET:
                position_um += one.value
            case InjectionKind.GAIN:
                position_um *= one.value
            case InjectionKind.NOISE:
                position_um += one.value * self._random.gauss()
            case InjectionKind.GARBAGE:
                position_um = one.value * self._random.uniform(-1.0, 1.0)
            case InjectionKind.DROPPED | InjectionKind.LOST:
                valid = False
        return Sample(t_ns, position_um, valid)

    def _at(self, axis: int, t_ns: int) -> Sample:
        """Return the last sample up to an instant, or the oldest that is remembered."""
        for samples in reversed(self._past):
            if samples[axis].t_ns <= t_ns:
                return samples[axis]
        return self._past[0][axis]
