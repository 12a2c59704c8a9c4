"""A wrapper that makes a device fail on a schedule, to test the reactions to faults.

Only tests construct it: no driver and no configuration can request it. Its time is the `now_ns` of
the calls, so a fault occurs in the same cycle in every run.
"""

from collections import deque
from collections.abc import Sequence
from math import nan
from random import Random
from typing import Final, Protocol

from piezod.devices.interface import Amplifier, Capabilities, Identity, KnowsTruth, Sample, Sensor
from piezod.devices.status import NO_FLAGS, Flags, TellsStatus
from piezod.testing.injections import Injection, InjectionKind

_STORED_SAMPLES: Final = 4096  # for late samples
_FLAGGED: Final = frozenset(
    {InjectionKind.FLAGGED, InjectionKind.SENSOR_FLAGGED, InjectionKind.LOST}
)


class FaultyError(Exception):
    """Error of a faulty driver; not one of piezod's own errors, as from a bad driver."""


class SensorAmplifier(Sensor, Amplifier, Protocol):
    """A device that is both sensor and amplifier."""


class FaultyDevice:
    """Implements `Sensor`, `Amplifier`, `KnowsTruth` and `TellsStatus` over another device.

    Args:
        inner: The device that works.
        schedule: Its failures; more may be added at any time.
        seed: Seed of noise and garbage.

    Attributes:
        inner: The device that works, which shows what really happens.
    """

    def __init__(
        self, inner: SensorAmplifier, schedule: Sequence[Injection] = (), seed: int = 0
    ) -> None:
        self.inner = inner
        # Checked once: to check a protocol takes longer than to read a device.
        self._truth = inner if isinstance(inner, KnowsTruth) else None
        self._flags = inner if isinstance(inner, TellsStatus) else None
        self.schedule = list(schedule)
        self._random = Random(seed)  # noqa: S311 - noise, no secret
        self._past: deque[Sequence[Sample]] = deque(maxlen=_STORED_SAMPLES)
        self._frozen: dict[int, Sample] = {}
        self._drive_v: Sequence[float] = ()

    def open(self) -> Identity:
        """Open the device."""
        return self.inner.open()

    def capabilities(self) -> Capabilities:
        """Return the capabilities of the device."""
        return self.inner.capabilities()

    def activate(self, now_ns: int) -> None:
        """Activate the device."""
        self.inner.activate(now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Deactivate the device."""
        self.inner.deactivate(now_ns)

    def close(self) -> None:
        """Close the device."""
        self.inner.close()

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return samples, changed by the faults.

        Raises:
            FaultyError: If that is the fault.
        """
        if self._any(InjectionKind.READ_RAISES, now_ns):
            raise FaultyError("the driver failed while it read")
        samples = list(self.inner.read(now_ns))
        self._past.append(tuple(samples))  # as they came, also while faults change them
        for one in self._now(now_ns):
            samples[one.axis] = self._spoilt(one, samples[one.axis], now_ns)
        # The next fault that freezes a sample of this axis must freeze a new one.
        for axis in set(self._frozen) - {one.axis for one in self._now(now_ns)}:
            del self._frozen[axis]
        return samples

    def true_position_um(self, now_ns: int) -> Sequence[float]:
        """Return the true displacement, NaN if the device does not know it."""
        if self._truth is not None:
            return self._truth.true_position_um(now_ns)
        return [nan] * len(self.capabilities().inputs)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set the voltages, unless a fault prevents it.

        Raises:
            FaultyError: If that is the fault.
        """
        if self._any(InjectionKind.WRITE_RAISES, now_ns):
            raise FaultyError("the driver failed while it wrote")
        if self._any(InjectionKind.REFUSED, now_ns) or self._any(InjectionKind.LOST, now_ns):
            return False
        sent_v = list(drive_v)
        for one in self._now(now_ns):
            # The write is accepted, but this output keeps its last voltage.
            if one.kind is InjectionKind.STUCK_OUTPUT and self._drive_v:
                sent_v[one.axis] = self._drive_v[one.axis]
        accepted = self.inner.write(sent_v, now_ns)
        if accepted:
            self._drive_v = sent_v
        return accepted and not self._any(InjectionKind.UNACKNOWLEDGED, now_ns)

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the voltages in force, changed by the faults."""
        values_v = list(self.inner.read_back(now_ns))
        for one in self._now(now_ns):
            if one.kind is InjectionKind.READ_BACK_OFFSET:
                values_v[one.axis] += one.value
            elif one.kind is InjectionKind.LOST:
                values_v[one.axis] = nan
        return values_v

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Return the flags of the device, plus those of the faults."""
        if self._flags is not None:
            flags = list(self._flags.status(now_ns))
        else:
            able = self.capabilities()
            flags = [NO_FLAGS] * (len(able.inputs) + len(able.outputs))
        for one in self._now(now_ns):
            if one.kind in _FLAGGED:
                flags[one.axis] |= {one.flag}
            # A lost or flagged device reports it for its outputs too.
            if one.kind in _FLAGGED - {InjectionKind.SENSOR_FLAGGED}:
                flags[len(self.capabilities().inputs) + one.axis] |= {one.flag}
        return flags

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
        """Return the last sample up to an instant, or the oldest one stored."""
        for samples in reversed(self._past):
            if samples[axis].t_ns <= t_ns:
                return samples[axis]
        return self._past[0][axis]
