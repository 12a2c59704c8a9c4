"""The driver contract of devices with an exchange, with a status, or with one role only."""

import math
from collections.abc import Sequence

import pytest

from piezod.devices.interface import Capabilities, Sample
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.testing import amplifier_checks, exchange_checks, status_checks
from piezod.testing.check_support import Check
from piezod.testing.driver_contract import checks_for
from tests.testing.test_driver_contract import PlainRig


class ExchangingRig(PlainRig):
    """Reads and writes in one exchange, and reports its status."""

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Write and read."""
        return self.write(drive_v, now_ns), self.read(now_ns)

    def status(self, now_ns: int) -> Sequence[Flags]:  # noqa: ARG002 - the interface gives the time
        """Report that the first input is saturated."""
        self.require(self.is_open, "not open")
        return [frozenset({DeviceFlag.SATURATED}), NO_FLAGS, NO_FLAGS, NO_FLAGS]


class AlwaysExchanges(ExchangingRig):
    """Returns samples while inactive too."""

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Write and read without checking the state."""
        return self.write(drive_v, now_ns), [Sample(now_ns, 0.0, True)] * 2


class ForgetsToWrite(ExchangingRig):
    """Reports success of a write that it ignores."""

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Read only."""
        return len(drive_v) == 2, self.read(now_ns)


class GivesOneSample(ExchangingRig):
    """Returns no sample of its last input."""

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Return a sample of the first input only."""
        taken, samples = super().exchange(drive_v, now_ns)
        return taken, samples[:1]


class AheadOfTime(ExchangingRig):
    """Returns samples dated after the call."""

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Return samples of a nanosecond from now."""
        return self.write(drive_v, now_ns), self.read(now_ns + 1)


class NothingWhenBad(ExchangingRig):
    """Returns no samples if it refuses the values."""

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Refuse the write and the read."""
        samples = self.read(now_ns)
        taken = self.write(drive_v, now_ns)
        return taken, samples if taken else ()


class TakesAnything(ExchangingRig):
    """Accepts NaN as a drive voltage in an exchange."""

    def in_range(self, axis_v: float) -> bool:
        """Accept every value that is not out of range."""
        return not (axis_v < 0 or axis_v > 150)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Refuse it in a plain write."""
        return all(map(math.isfinite, drive_v)) and super().write(drive_v, now_ns)

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Write without a check."""
        return super().write([*drive_v][:2], now_ns), self.read(now_ns)


class TellsTheOutputsOnly(ExchangingRig):
    """Reports no flags of its inputs."""

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Return the flags of two channels."""
        return super().status(now_ns)[2:]


class TellsWhileClosed(ExchangingRig):
    """Reports a status while it is closed."""

    def status(self, now_ns: int) -> Sequence[Flags]:  # noqa: ARG002 - as above
        """Return a status at any time."""
        return [NO_FLAGS] * 4


class TellsWords(ExchangingRig):
    """Reports flags that are not in `DeviceFlag`."""

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Return unknown flags."""
        return [frozenset({"tired"}) for _ in super().status(now_ns)]  # type: ignore[arg-type] # the breach


class SensorOnly(ExchangingRig):
    """Measures both axes and has no outputs, although it has the methods."""

    def capabilities(self) -> Capabilities:
        """Return no outputs."""
        return super().capabilities()._replace(outputs=())

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:  # noqa: ARG002 - as above
        """Accept an empty list of values."""
        return self.is_active and not drive_v

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return nothing."""
        return super().read_back(now_ns)[:0]

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Return the flags of the inputs."""
        return super().status(now_ns)[:2]


class AmplifierOnly(ExchangingRig):
    """Drives both axes and has no inputs, although it has the methods."""

    def capabilities(self) -> Capabilities:
        """Return no inputs."""
        return super().capabilities()._replace(inputs=())

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return nothing."""
        return super().read(now_ns)[:0]

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Return the flags of the outputs."""
        return super().status(now_ns)[2:]


class Slow(PlainRig):
    """Reaches its voltage after a few read-backs."""

    def __init__(self) -> None:
        super().__init__()
        self.asked = 0

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the former value three times."""
        self.asked += 1
        return [0.0, 0.0] if self.asked % 4 else super().read_back(now_ns)


KEEPING = (ExchangingRig, SensorOnly, AmplifierOnly)
BREACHES = [
    (AlwaysExchanges, exchange_checks.an_exchange_needs_an_active_device),
    (ForgetsToWrite, exchange_checks.an_exchange_writes_and_reads),
    (GivesOneSample, exchange_checks.an_exchange_writes_and_reads),
    (AheadOfTime, exchange_checks.an_exchange_writes_and_reads),
    (NothingWhenBad, exchange_checks.a_bad_exchange_is_refused_and_reads),
    (TakesAnything, exchange_checks.a_bad_exchange_is_refused_and_reads),
    (TellsWhileClosed, status_checks.status_needs_an_open_device),
    (TellsTheOutputsOnly, status_checks.every_channel_has_its_flags),
    (TellsWords, status_checks.every_channel_has_its_flags),
]


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do not wait: these devices run on the simulated clock."""
    monkeypatch.setattr("piezod.testing.amplifier_bench.PATIENCE_S", 0.0)


@pytest.mark.parametrize("rig", KEEPING)
@pytest.mark.usefixtures("impatient")
def test_device_that_keeps_the_contract_passes(
    rig: type[ExchangingRig], subtests: pytest.Subtests
) -> None:
    """This holds with both roles, and with one role and no channels of the other."""
    for check in checks_for(rig):
        with subtests.test(check.__name__):
            check(rig)


@pytest.mark.parametrize(("breach", "check"), BREACHES)
@pytest.mark.usefixtures("impatient")
def test_breach_is_found(breach: type[PlainRig], check: Check) -> None:
    """A device that breaks one rule fails the check of that rule."""
    assert check in checks_for(ExchangingRig)
    assert check not in checks_for(PlainRig)

    with pytest.raises(AssertionError):
        check(breach)


class Holding(ExchangingRig):
    """Keeps its drive, also when it is closed; its maximum is 3 V."""

    left_v: Sequence[float] = (0.0, 0.0)

    def __init__(self) -> None:
        super().__init__()
        self.drive_v = list(self.left_v)

    def capabilities(self) -> Capabilities:
        """Return that it holds."""
        return super().capabilities()._replace(holds=True)

    def deactivate(self, now_ns: int) -> None:  # noqa: ARG002 - as above
        """Keep the drive."""
        self.is_active = False
        type(self).left_v = tuple(self.drive_v)

    def in_range(self, axis_v: float) -> bool:
        """Return whether one axis can be driven to this value."""
        return super().in_range(axis_v) and axis_v <= 3.0


@pytest.mark.usefixtures("impatient")
def test_a_device_that_holds_is_left_where_it_was() -> None:
    """Each check starts from the initial voltage, for any number of checks."""
    for check in checks_for(Holding):
        check(Holding)

    assert Holding.left_v == (0.0, 0.0)


def test_a_device_in_real_time_is_waited_for() -> None:
    """Its read-back is polled until it settles, because it does not follow the simulated clock."""
    amplifier_checks.a_write_comes_into_force(Slow)
