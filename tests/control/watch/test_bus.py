"""Tests of what is said of the way to an axis' devices, from what they tell of it."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.faults.cases import CASES, COUNTED_FLAGS, UNREACHABLE, Case
from piezod.control.faults.register import Detection
from piezod.control.watch.bus import AT_ONCE, NOT_SENT_CYCLES, BusWatch
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags

BUS_FLAGS = [*AT_ONCE, *COUNTED_FLAGS, DeviceFlag.NOT_SENT]


def of(*flags: DeviceFlag) -> Flags:
    """Return what a device tells."""
    return frozenset(flags)


def told(found: Sequence[Detection]) -> list[tuple[str, Case]]:
    """Return ids and cases of what was found."""
    return [(detection.fault, detection.case) for detection in found]


def cycles(watch: BusWatch, count: int, sensor: Flags, amplifier: Flags) -> list[bool]:
    """Return in which of some cycles more was found than what is only counted."""
    runs = (watch.check(sensor, amplifier) for _ in range(count))
    return [any(one.case is not Case.SINGLE for one in found) for found in runs]


def test_what_is_only_counted_has_a_case_of_its_own() -> None:
    """Every such fault, and no other."""
    counted = {fault for fault, case in CASES if case is Case.SINGLE}

    assert counted == {*COUNTED_FLAGS.values(), "B9"}


def test_nothing_is_found_where_nothing_is_told() -> None:
    """Without so much as a list."""
    watch = BusWatch(0)

    assert watch.check(NO_FLAGS, NO_FLAGS) == ()
    assert not watch.explains_silence


@pytest.mark.parametrize("flag", AT_ONCE)
def test_what_no_second_try_mends_is_told_in_the_same_cycle(flag: DeviceFlag) -> None:
    """Once, where one device plays both roles; and it is gone when it is told no more."""
    watch = BusWatch(0)
    first = told(watch.check(of(flag), of(flag)))
    after = watch.check(NO_FLAGS, NO_FLAGS)

    assert [fault for fault, _ in first] == [AT_ONCE[flag]]
    assert Case.SENSOR not in [case for _, case in first]
    assert after == ()


@pytest.mark.parametrize("flag", COUNTED_FLAGS)
def test_what_happens_now_and_then_is_counted_and_a_fault_at_the_fifth_in_a_row(
    flag: DeviceFlag,
) -> None:
    """One in four for ever is none."""
    watch, other = BusWatch(0), BusWatch(0)
    single = told(watch.check(of(flag), of(flag)))
    rest = cycles(watch, 5, of(flag), of(flag))
    seldom = [
        cycles(other, 1, NO_FLAGS, of(flag) if k % 4 == 0 else NO_FLAGS)[0] for k in range(1000)
    ]

    assert set(single) == {(COUNTED_FLAGS[flag], Case.SINGLE)}
    assert rest == [False] * 3 + [True] * 2
    assert not any(seldom)


@pytest.mark.fault("B9")
def test_three_frames_in_a_row_that_cannot_be_sent_are_a_fault() -> None:
    """Two are not, however often."""
    watch, other = BusWatch(0), BusWatch(0)
    lost = of(DeviceFlag.NOT_SENT)
    pairs = [cycles(other, 1, NO_FLAGS, lost if k % 3 else NO_FLAGS)[0] for k in range(300)]

    assert cycles(watch, NOT_SENT_CYCLES, NO_FLAGS, lost) == [False, False, True]
    assert not any(pairs)


@pytest.mark.parametrize("flag", [flag for flag in BUS_FLAGS if flag is not DeviceFlag.BUSY])
def test_a_device_that_only_measures_makes_no_amplifier_unreachable(flag: DeviceFlag) -> None:
    """What would be BLIND of an amplifier is another case of a sensor, and explains its silence."""
    watch = BusWatch(0)
    for _ in range(5):
        found = told(watch.check(of(flag), NO_FLAGS))

    ((fault, case),) = found
    assert (case is Case.SENSOR) == (fault in UNREACHABLE)
    assert watch.explains_silence


def test_the_way_to_the_amplifier_explains_no_silence_of_the_sensor() -> None:
    """They are two devices."""
    watch = BusWatch(0)
    found = watch.check(NO_FLAGS, of(DeviceFlag.DISCONNECTED))

    assert told(found) == [("B1", Case.USUAL)]
    assert not watch.explains_silence


@pytest.mark.fault("B10")
def test_what_a_code_means_is_told() -> None:
    """A mistake in the configuration, a device that failed, and one that has no time."""
    watch = BusWatch(0)
    request = watch.check(NO_FLAGS, of(DeviceFlag.WRONG_REQUEST))
    failure = watch.check(NO_FLAGS, of(DeviceFlag.DEVICE_FAILURE))
    for _ in range(5):
        busy = watch.check(NO_FLAGS, of(DeviceFlag.BUSY))

    assert told(request) == [("B10", Case.REQUEST)]
    assert told(failure) == [("B10", Case.USUAL)]
    assert told(busy) == [("B10", Case.BUSY)]


@pytest.mark.fault("S10")
def test_another_amplifier_is_worse_than_another_sensor() -> None:
    """Nobody ramps what is not the amplifier that was configured."""
    other = of(DeviceFlag.OTHER_DEVICE)

    assert told(BusWatch(0).check(other, NO_FLAGS)) == [("S10", Case.USUAL)]
    assert told(BusWatch(0).check(NO_FLAGS, other)) == [("S10", Case.AMPLIFIER)]
    assert told(BusWatch(0).check(other, other)) == [("S10", Case.AMPLIFIER)]


@given(
    st.lists(
        st.tuples(
            st.frozensets(st.sampled_from(DeviceFlag)), st.frozensets(st.sampled_from(DeviceFlag))
        ),
        max_size=50,
    )
)
def test_whatever_was_told_is_forgotten_when_nothing_is(rounds: list[tuple[Flags, Flags]]) -> None:
    """In ten cycles; and each detection is a case that there is, of this axis."""
    watch = BusWatch(3)
    for sensor, amplifier in rounds:
        assert all(one.axis == 3 for one in watch.check(sensor, amplifier))
    for _ in range(10):
        watch.check(NO_FLAGS, NO_FLAGS)

    assert watch.check(NO_FLAGS, NO_FLAGS) == ()
