"""Tests of what is said of an amplifier, from its acknowledgements, its read-back and its flags."""

import math
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.faults import Fault
from piezod.control.faults.register import Detection
from piezod.control.guard import Limits
from piezod.control.watch.amplifier import FLAG_FAULTS, AmplifierWatch
from piezod.devices.status import NO_FLAGS, DeviceFlag
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
        """Return where it is a cycle later."""
        self.volts += self._part * (drive_v - self.volts)
        return self.volts


def test_nothing_is_found_in_an_amplifier_that_follows() -> None:
    """Sines of 1 and 50 Hz, steps at full slew, and rest."""
    one, output = watch(), Output()
    found: list[Detection] = []
    drives = [sine_v(k, 1.0) for k in range(5000)] + [sine_v(k) for k in range(5000)]
    drives += [min(max(0.0, (k % 40 - 20) * 20.0), 150.0) for k in range(4000)] + [30.0] * 1000
    in_force_v = 0.0
    for drive_v in drives:
        found += one.check(output.follow(in_force_v), NO_FLAGS)
        one.wrote(drive_v, taken=True)
        in_force_v = drive_v

    assert found == []


@pytest.mark.fault("A1")
@pytest.mark.fault("A2")
def test_five_writes_that_were_not_taken_are_told() -> None:
    """After the fifth; a write that is taken at last is not enough to forget, and no A3 comes."""
    one = watch()
    found: list[list[str]] = []
    for k in range(8):
        found.append(ids(one.check(50.0, NO_FLAGS)))
        one.wrote(50.0 + k, taken=k == 0)

    assert found == [[]] * 6 + [[Fault.A1]] * 2


@pytest.mark.fault("A1")
def test_single_refusals_are_forgiven() -> None:
    """One write in ten may be refused for ever."""
    one = watch()
    found: list[Detection] = []
    for k in range(1000):
        found += one.check(50.0, NO_FLAGS)
        one.wrote(50.0, taken=k % 10 != 0)

    assert found == []


@pytest.mark.fault("A3")
def test_a_read_back_may_lag_as_long_as_nobody_waits_for_it() -> None:
    """An amplifier behind a worker tells what was in force 20 ms ago; stuck, it is told later."""
    one = AmplifierWatch(0, LIMITS, round(LAG_MS * MS), MS, 20 * MS)
    told_v = [5.0] * 20
    found: list[Detection] = []
    for k in range(2000):
        drive_v = sine_v(k)
        found += one.check(told_v.pop(0), NO_FLAGS)
        one.wrote(drive_v, taken=True)
        told_v.append(drive_v)

    assert found == []
    stuck: list[Detection] = []
    for _ in range(200):
        stuck += one.check(75.0, NO_FLAGS)
        one.wrote(140.0, taken=True)
    assert Fault.A3 in ids(stuck)


@pytest.mark.fault("A3")
@pytest.mark.parametrize("off_v", [-1.0, 1.0])
def test_a_voltage_that_is_not_the_one_written_is_told_after_three_cycles(off_v: float) -> None:
    """With by how much it is off, and how much is allowed."""
    one = watch()
    found: list[Sequence[Detection]] = []
    for k in range(10):
        found.append(one.check(50.0 + off_v * (k >= 5), NO_FLAGS))
        one.wrote(50.0, taken=True)

    assert [ids(each) for each in found] == [[]] * 7 + [[Fault.A3]] * 3
    assert found[-1][0].measured == pytest.approx(1.0)
    assert found[-1][0].limit == 0.75


@pytest.mark.fault("A3")
def test_an_output_that_is_stuck_is_told_while_the_drive_moves_away() -> None:
    """It acknowledges every write, and stays at 75 V."""
    one, cycle = watch(), 0
    while not (found := one.check(75.0, NO_FLAGS)):
        one.wrote(75.0 + 0.2 * cycle, taken=True)
        cycle += 1

    assert ids(found) == [Fault.A3]
    assert cycle < 20


def test_a_stage_that_nobody_drives_may_be_anywhere() -> None:
    """Somebody turns the amplifier's knob in SAFE: neither A3 nor A7, nor later."""
    one = watch()
    found: list[Detection] = []
    one.wrote(0.0, taken=True)
    for k in range(100):
        found += one.check(k * 1.5 if k < 50 else 140.0, NO_FLAGS)
    for _ in range(10):
        one.wrote(140.0, taken=True)
        found += one.check(140.0, NO_FLAGS)

    assert found == []


@pytest.mark.fault("A5")
def test_a_command_that_is_no_number_is_told_at_once() -> None:
    """In the cycle after, and not again."""
    one = watch()
    one.check(50.0, NO_FLAGS)
    one.wrote(50.0, taken=True, refused=True)
    first = one.check(50.0, NO_FLAGS)
    one.wrote(50.0, taken=True)

    assert ids(first) == [Fault.A5]
    assert ids(one.check(50.0, NO_FLAGS)) == []


@pytest.mark.fault("A6")
@pytest.mark.parametrize(("which", "cycles"), [("range_limited", 20), ("slew_limited", 100)])
def test_a_drive_that_is_limited_for_long_is_told(which: str, cycles: int) -> None:
    """From so many cycles in a row on, until it is limited no more."""
    one, first = watch(), 0
    for k in range(2 * cycles):
        if one.check(math.nan, NO_FLAGS) and not first:
            first = k
        one.wrote(150.0, taken=True, **{which: True})
    one.wrote(150.0, taken=True)

    assert first == cycles
    assert one.check(math.nan, NO_FLAGS) == ()


@pytest.mark.fault("A7")
def test_a_voltage_that_collapses_is_told_in_its_own_cycle() -> None:
    """From 100 V to 10 V, and nothing was written but 100 V."""
    one = watch()
    for _ in range(10):
        one.check(100.0, NO_FLAGS)
        one.wrote(100.0, taken=True)

    assert one.check(10.0, NO_FLAGS) == [Detection(Fault.A7, 0, 90.0, 20.0)]


@pytest.mark.fault("A12")
def test_over_voltage_is_told_after_two_cycles() -> None:
    """2 V beyond the limits; with what was read, and the limit."""
    one = watch()
    one.check(149.0, NO_FLAGS)
    first = one.check(152.5, NO_FLAGS)

    assert ids(first) == []
    assert one.check(152.5, NO_FLAGS) == [Detection(Fault.A12, 0, 152.5, 150.0)]


def test_a_stage_taken_over_outside_its_limits_is_not_cut_off() -> None:
    """It is at 160 V when the daemon starts; the guard brings it back, and only then A12 holds."""
    one = watch()
    found: list[Detection] = []
    for k in range(50):
        found += one.check(160.0 - k, NO_FLAGS)
        one.wrote(160.0 - k, taken=True)
    found += one.check(153.0, NO_FLAGS)
    last = one.check(153.0, NO_FLAGS)

    assert Fault.A12 not in ids(found)
    assert Fault.A12 in ids(last)


@pytest.mark.parametrize(
    ("flag", "fault"),
    [
        pytest.param(flag, fault, marks=pytest.mark.fault(fault))
        for flag, fault in FLAG_FAULTS.items()
    ],
)
def test_what_an_amplifier_says_of_itself_is_told(flag: DeviceFlag, fault: Fault) -> None:
    """As long as it says so, driven or not."""
    one = watch()

    assert one.check(0.0, frozenset({flag})) == [Detection(fault, 0)]
    assert one.check(0.0, NO_FLAGS) == ()


@given(st.lists(st.floats(), max_size=30), st.floats(0, 150))
def test_no_read_back_raises(read_back_v: list[float], drive_v: float) -> None:
    """Whatever an amplifier claims, the answer is a list of faults; of no number, none."""
    one = watch()
    for volts in read_back_v:
        found = one.check(volts, NO_FLAGS)
        one.wrote(drive_v, taken=True)
        assert math.isfinite(volts) or not found
