"""Tests of the watch of the amplifier: acknowledgements, read-back and flags."""

import math
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.control.guard import Limits
from piezod.control.watch.amplifier import FLAG_FAULTS, AmplifierWatch
from piezod.devices.status import MOVED, NO_FLAGS, DeviceFlag
from tests.conftest import Reaction
from tests.control.fakes import MS

LIMITS = Limits(0.0, 150.0, 20_000.0)
LAG_MS = 0.4


def watch() -> AmplifierWatch:
    """Return the watch of the first axis at 1 kHz."""
    return AmplifierWatch(0, LIMITS, round(LAG_MS * MS), MS)


def sine_v(k: int, hz: float = 50.0) -> float:
    """Return a drive between 5 and 145 V, in cycles of 1 ms."""
    return 75.0 - 70.0 * math.cos(2e-3 * math.pi * hz * k)


def ids(found: Sequence[Detection]) -> list[str]:
    """Return the ids of the faults."""
    return [detection.fault for detection in found]


class Output:
    """An amplifier whose output follows with a time constant, in cycles."""

    def __init__(self, lag_cycles: float = LAG_MS) -> None:
        self.volts = 0.0
        self._part = 1.0 - math.exp(-1.0 / lag_cycles)

    def follow(self, drive_v: float) -> float:
        """Return the output voltage one cycle later."""
        self.volts += self._part * (drive_v - self.volts)
        return self.volts


def test_amplifier_that_follows_has_no_fault() -> None:
    """Sines of 1 and 50 Hz, steps at the slew rate, and rest are healthy."""
    subject, output = watch(), Output()
    found: list[Detection] = []
    drives = [sine_v(k, 1.0) for k in range(5000)] + [sine_v(k) for k in range(5000)]
    drives += [min(max(0.0, (k % 40 - 20) * 20.0), 150.0) for k in range(4000)] + [30.0] * 1000
    in_force_v = 0.0
    for drive_v in drives:
        found += subject.check(output.follow(in_force_v), NO_FLAGS)
        subject.wrote(drive_v, taken=True)
        in_force_v = drive_v

    assert found == []


@pytest.mark.fault("A1")
def test_five_refused_writes_are_detected() -> None:
    """A1 comes after the fifth; one later success does not clear it, and A3 does not come."""
    subject = watch()
    found: list[list[str]] = []
    for k in range(8):
        found.append(ids(subject.check(50.0, NO_FLAGS)))
        subject.wrote(50.0 + k, taken=k == 0)

    assert found == [[]] * 6 + [[Fault.A1]] * 2


def test_single_refused_writes_are_no_fault() -> None:
    """One write in ten may be refused for ever."""
    subject = watch()
    found: list[Detection] = []
    for k in range(1000):
        found += subject.check(50.0, NO_FLAGS)
        subject.wrote(50.0, taken=k % 10 != 0)

    assert found == []


@pytest.mark.fault("A3")
def test_read_back_of_a_worker_may_lag() -> None:
    """A worker reports the voltage of 20 ms ago; a stuck output is still detected."""
    subject = AmplifierWatch(0, LIMITS, round(LAG_MS * MS), MS, 20 * MS)
    reported_v = [5.0] * 20
    found: list[Detection] = []
    for k in range(2000):
        drive_v = sine_v(k)
        found += subject.check(reported_v.pop(0), NO_FLAGS)
        subject.wrote(drive_v, taken=True)
        reported_v.append(drive_v)

    assert found == []
    stuck: list[Detection] = []
    for _ in range(200):
        stuck += subject.check(75.0, NO_FLAGS)
        subject.wrote(140.0, taken=True)
    assert Fault.A3 in ids(stuck)


@pytest.mark.fault("A3")
@pytest.mark.parametrize("off_v", [-1.0, 1.0])
def test_wrong_read_back_is_detected_after_three_cycles(off_v: float) -> None:
    """The detection has the deviation and the allowed deviation."""
    subject = watch()
    found: list[Sequence[Detection]] = []
    for k in range(10):
        found.append(subject.check(50.0 + off_v * (k >= 5), NO_FLAGS))
        subject.wrote(50.0, taken=True)

    assert [ids(each) for each in found] == [[]] * 7 + [[Fault.A3]] * 3
    assert found[-1][0].measured == pytest.approx(1.0)
    assert found[-1][0].limit == 0.75


@pytest.mark.fault("A3")
def test_stuck_output_is_detected_while_the_drive_moves() -> None:
    """The amplifier acknowledges every write, and stays at 75 V."""
    subject, cycle = watch(), 0
    while not (found := subject.check(75.0, NO_FLAGS)):
        subject.wrote(75.0 + 0.2 * cycle, taken=True)
        cycle += 1

    assert ids(found) == [Fault.A3]
    assert cycle < 20


def test_output_that_is_not_driven_may_have_any_voltage() -> None:
    """Turning the knob in SAFE is neither A3 nor A7, then or later."""
    subject = watch()
    found: list[Detection] = []
    subject.wrote(0.0, taken=True)
    for k in range(100):
        found += subject.check(k * 1.5 if k < 50 else 140.0, NO_FLAGS)
    for _ in range(10):
        subject.wrote(140.0, taken=True)
        found += subject.check(140.0, NO_FLAGS)

    assert found == []


@pytest.mark.fault("A5")
def test_request_that_is_not_a_number_is_detected_at_once() -> None:
    """It is detected in the next cycle, once."""
    subject = watch()
    subject.check(50.0, NO_FLAGS)
    subject.wrote(50.0, taken=True, refused=True)
    first = subject.check(50.0, NO_FLAGS)
    subject.wrote(50.0, taken=True)

    assert ids(first) == [Fault.A5]
    assert ids(subject.check(50.0, NO_FLAGS)) == []


@pytest.mark.fault("A6")
@pytest.mark.parametrize(("which", "cycles"), [("range_limited", 20), ("slew_limited", 100)])
def test_drive_that_is_limited_for_long_is_detected(
    which: str, cycles: int, reaction: Reaction
) -> None:
    """It is detected after this many cycles in a row, until it is no longer limited."""
    subject, first = watch(), 0
    for k in range(2 * cycles):
        if subject.check(math.nan, NO_FLAGS) and not first:
            first = k
        subject.wrote(150.0, taken=True, **{which: True})
    subject.wrote(150.0, taken=True)

    assert first == cycles
    reaction("A6", cycles=first + 1)
    assert subject.check(math.nan, NO_FLAGS) == ()


@pytest.mark.fault("A7")
def test_collapse_is_detected_in_its_own_cycle() -> None:
    """The read-back falls from 100 V to 10 V although 100 V was written."""
    subject = watch()
    for _ in range(10):
        subject.check(100.0, NO_FLAGS)
        subject.wrote(100.0, taken=True)

    assert subject.check(10.0, NO_FLAGS) == [Detection(Fault.A7, 0, 90.0, 20.0)]


@pytest.mark.fault("A12")
def test_over_voltage_is_detected_after_two_cycles() -> None:
    """More than 2 V outside the limits is detected, with the read-back and the limit."""
    subject = watch()
    subject.check(149.0, NO_FLAGS)
    first = subject.check(152.5, NO_FLAGS)

    assert ids(first) == []
    assert subject.check(152.5, NO_FLAGS) == [Detection(Fault.A12, 0, 152.5, 150.0)]


def test_output_taken_over_outside_its_limits_is_not_cut() -> None:
    """It is at 160 V at the start; the guard brings it back, and only then A12 is possible."""
    subject = watch()
    found: list[Detection] = []
    for k in range(50):
        found += subject.check(160.0 - k, NO_FLAGS)
        subject.wrote(160.0 - k, taken=True)
    found += subject.check(153.0, NO_FLAGS)
    last = subject.check(153.0, NO_FLAGS)

    assert Fault.A12 not in ids(found)
    assert Fault.A12 in ids(last)


@pytest.mark.parametrize(
    ("flag", "fault"),
    [
        pytest.param(flag, fault, marks=pytest.mark.fault(fault))
        for flag, fault in FLAG_FAULTS.items()
    ],
)
def test_flags_of_the_amplifier_are_faults(flag: DeviceFlag, fault: Fault) -> None:
    """A fault lasts as long as its flag, driven or not."""
    subject = watch()

    assert subject.check(0.0, frozenset({flag})) == [Detection(fault, 0)]
    assert subject.check(0.0, NO_FLAGS) == ()


@pytest.mark.parametrize("flag", sorted(MOVED))
def test_reported_move_is_kept_until_a_write_is_acknowledged(flag: DeviceFlag) -> None:
    """Neither a refused write nor a loss ends it, nor a write that local mode does not follow."""
    subject = watch()
    subject.check(30.0, frozenset({flag}))
    subject.forget()
    subject.check(30.0, NO_FLAGS)
    subject.wrote(30.0, taken=False)
    kept = subject.reports_move
    subject.check(30.0, frozenset({flag}))
    subject.wrote(30.0, taken=True)
    in_the_same_cycle = subject.reports_move
    subject.check(30.0, NO_FLAGS)
    subject.wrote(30.0, taken=True)

    assert kept
    assert in_the_same_cycle == (flag is DeviceFlag.LOCAL_MODE)
    assert not subject.reports_move


@given(st.lists(st.floats(), max_size=30), st.floats(0, 150))
def test_no_read_back_raises(read_back_v: list[float], drive_v: float) -> None:
    """Any read-back gives a list of faults; one that is not finite gives none."""
    subject = watch()
    for volts in read_back_v:
        found = subject.check(volts, NO_FLAGS)
        subject.wrote(drive_v, taken=True)
        assert math.isfinite(volts) or not found


@pytest.mark.fault("A3")
def test_output_that_is_waited_for_is_told() -> None:
    """Old writes explain a read-back no longer, although nothing new is written."""
    subject, found = watch(), list[str]()
    for drive_v in (20.0, 24.0, 28.0, 32.0):
        subject.check(drive_v - 4.0, NO_FLAGS)
        subject.wrote(drive_v, taken=True)
    for _ in range(20):
        found += ids(subject.check(22.0, NO_FLAGS))
        subject.waited(32.0)

    assert Fault.A3 in found
    assert not subject.follows
