"""Steps while the computer, or a device, is late."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import count
from math import nan

import pytest

from piezod.commission.procedure import Findings, ProcedureStep, steps_of
from piezod.commission.session import Session
from piezod.devices.interface import Device, Sample
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, LatenessError
from piezod.testing.fake_clock import FakeClock
from piezod.units import NS_PER_S
from tests.commission.axes import session

RATE_HZ = 100.0
PERIOD_NS = round(NS_PER_S / RATE_HZ)


class Busy:
    """A computer that has no time for some of the cycles, and a device without replies then.

    Args:
        axis: The axis.
        until: Number of the step's attempt before which it is busy.
    """

    def __init__(self, axis: Session, until: float) -> None:
        self._clock, self._until = axis._clock, until  # noqa: SLF001 - the test's own
        assert isinstance(self._clock, FakeClock)
        self._sleep, self._cycles = self._clock.sleep_until_ns, count()
        self._clock.sleep_until_ns = self.oversleep  # type: ignore[method-assign] # of this one
        self._status = axis._channels.status  # noqa: SLF001 - what the devices report
        self._read = axis._channels.read  # noqa: SLF001 - likewise
        axis._channels.status, axis._channels.read = self.status, self.read  # type: ignore[method-assign] # noqa: SLF001 - likewise
        self.attempt, self._late = 0, False

    def oversleep(self, t_ns: int) -> None:
        """Sleep, every third time for three periods too long."""
        self._late = self.attempt < self._until and next(self._cycles) % 3 == 0
        self._sleep(t_ns + 3 * PERIOD_NS * self._late)

    def read(self, now_ns: int) -> list[Sample]:
        """Return no sample in a late cycle."""
        samples = self._read(now_ns)
        return [Sample(now_ns, nan, False)] if self._late else samples

    def status(self, now_ns: int) -> list[frozenset[DeviceFlag]]:
        """Report a missing reply in a late cycle."""
        late = frozenset({DeviceFlag.LATE_REPLY}) if self._late else frozenset()
        return [late | flags for flags in self._status(now_ns)]

    def again(self, _reason: str) -> None:
        """Count a repetition."""
        self.attempt += 1


@contextmanager
def busy(
    until: float, wrap: Callable[[Device], Device] = lambda device: device
) -> Iterator[tuple[Session, Busy, Iterator[ProcedureStep]]]:
    """Yield an axis, its computer, and the steps."""
    with session(rate_hz=RATE_HZ, wrap=wrap) as axis:
        computer = Busy(axis, until)
        yield axis, computer, steps_of(axis, Findings(), computer.again)


def blind_above_v(drive_v: float, device: Device) -> Device:
    """Have a sensor at its end above a voltage."""
    read, read_back = device.read, device.read_back  # type: ignore[attr-defined] # the rig is both

    def reading(now_ns: int) -> Sequence[Sample]:
        high = read_back(now_ns)[0] > drive_v
        return [sample._replace(valid=not high) for sample in read(now_ns)]

    device.read = reading  # type: ignore[attr-defined] # of this one
    return device


def test_every_step_is_repeated_until_it_is_punctual() -> None:
    """A computer that is busy for two attempts changes no result, and the axis is back."""
    with busy(2) as (axis, computer, steps):
        for step in steps:
            computer.attempt = 0
            assert step.run()
            assert computer.attempt == 2

        assert axis.drive_v == pytest.approx(0.0, abs=1e-6)


def test_computer_that_stays_busy_is_the_reason() -> None:
    """Late samples are not taken for a sensor at its end, in any step."""
    with busy(99) as (_, computer, steps):
        for step in steps:
            computer.attempt = 0
            with pytest.raises(LatenessError, match=r"^the computer was late: "):
                step.run()


@pytest.mark.parametrize("until", [0, 1])
def test_sensor_at_its_end_is_still_the_reason(until: int) -> None:
    """A punctual attempt tells it, also if the one before was late."""
    with busy(until, partial(blind_above_v, 20.0)) as (_, computer, steps):
        noise, polarity, small, large, *_ = steps
        for step in (noise, polarity, small):
            computer.attempt = 0
            assert step.run()
        computer.attempt = 0
        with pytest.raises(DeviceError, match="the sensor is at the end of its range"):
            large.run()


def test_few_late_samples_are_not_those_of_the_sensor() -> None:
    """They are left out of the share of valid samples."""
    with busy(99) as (axis, _, _steps):
        trace = axis.rest(1.0)
        lateness = axis.take_lateness()

    assert trace.valid_pct == 100.0
    assert lateness.unanswered > 0
    assert lateness.began_late > lateness.unanswered
    assert axis.take_lateness().cycles == 0


def test_read_back_that_comes_late_is_waited_for() -> None:
    """The voltage in force is not unknown because of one late reply at the start."""
    told = iter([nan, nan])

    def late(device: Device) -> Device:
        read_back = device.read_back  # type: ignore[attr-defined] # the rig is both

        def reading_back(now_ns: int) -> Sequence[float]:
            there = read_back(now_ns)
            return [next(told, there[0])]

        device.read_back = reading_back  # type: ignore[attr-defined] # of this one
        return device

    with session(wrap=late) as axis:
        assert axis.found_v == pytest.approx(0.0, abs=0.1)
