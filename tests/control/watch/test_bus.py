"""Tests of the watch of the buses, by the flags of the devices."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.faults.cases import CASES, COUNTED_FLAGS, UNREACHABLE, Case
from piezod.control.faults.detection import Detection
from piezod.control.watch.bus import AT_ONCE, NOT_SENT_CYCLES, BusWatch
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags

BUS_FLAGS = [*AT_ONCE, *COUNTED_FLAGS, DeviceFlag.NOT_SENT]


def of(*flags: DeviceFlag) -> Flags:
    """Return flags as a device reports them."""
    return frozenset(flags)


def ids_and_cases(found: Sequence[Detection]) -> list[tuple[str, Case]]:
    """Return ids and cases of the detections."""
    return [(detection.fault, detection.case) for detection in found]


def cycles(watch: BusWatch, count: int, sensor: Flags, amplifier: Flags) -> list[bool]:
    """Return for some cycles whether more than a single event was detected."""
    runs = (watch.check(sensor, amplifier) for _ in range(count))
    return [any(one.case is not Case.SINGLE for one in found) for found in runs]


def test_counted_faults_have_the_case_of_a_single_event() -> None:
    """Every counted fault has it, and no other."""
    counted = {fault for fault, case in CASES if case is Case.SINGLE}

    assert counted == {*COUNTED_FLAGS.values(), "B9"}


def test_without_flags_nothing_is_detected() -> None:
    """The result is not even a list."""
    watch = BusWatch(0)

    assert watch.check(NO_FLAGS, NO_FLAGS) == ()
    assert not watch.explains_silence


@pytest.mark.parametrize("flag", AT_ONCE)
def test_flags_that_no_retry_clears_are_faults_in_the_same_cycle(flag: DeviceFlag) -> None:
    """One device with both roles reports the fault once; it is gone with its flag."""
    watch = BusWatch(0)
    first = ids_and_cases(watch.check(of(flag), of(flag)))
    after = watch.check(NO_FLAGS, NO_FLAGS)

    assert [fault for fault, _ in first] == [AT_ONCE[flag]]
    assert Case.SENSOR not in [case for _, case in first]
    assert after == ()


@pytest.mark.parametrize("flag", COUNTED_FLAGS)
def test_counted_flags_are_faults_at_the_fifth_in_a_row(
    flag: DeviceFlag,
) -> None:
    """One in four cycles for ever is no fault."""
    watch, other = BusWatch(0), BusWatch(0)
    single = ids_and_cases(watch.check(of(flag), of(flag)))
    rest = cycles(watch, 5, of(flag), of(flag))
    seldom = [
        cycles(other, 1, NO_FLAGS, of(flag) if k % 4 == 0 else NO_FLAGS)[0] for k in range(1000)
    ]

    assert set(single) == {(COUNTED_FLAGS[flag], Case.SINGLE)}
    assert rest == [False] * 3 + [True] * 2
    assert not any(seldom)


@pytest.mark.fault("B9")
def test_three_frames_in_a_row_that_cannot_be_sent_are_a_fault() -> None:
    """Two in a row are no fault, however often."""
    watch, other = BusWatch(0), BusWatch(0)
    lost = of(DeviceFlag.NOT_SENT)
    pairs = [cycles(other, 1, NO_FLAGS, lost if k % 3 else NO_FLAGS)[0] for k in range(300)]

    assert cycles(watch, NOT_SENT_CYCLES, NO_FLAGS, lost) == [False, False, True]
    assert not any(pairs)


@pytest.mark.parametrize("flag", [flag for flag in BUS_FLAGS if flag is not DeviceFlag.BUSY])
def test_lost_sensor_is_another_case_and_explains_missing_samples(flag: DeviceFlag) -> None:
    """Faults that would be BLIND for an amplifier have the case of a sensor."""
    watch = BusWatch(0)
    for _ in range(5):
        found = ids_and_cases(watch.check(of(flag), NO_FLAGS))

    ((fault, case),) = found
    assert (case is Case.SENSOR) == (fault in UNREACHABLE)
    assert watch.explains_silence


def test_lost_amplifier_does_not_explain_missing_samples() -> None:
    """They are two devices."""
    watch = BusWatch(0)
    found = watch.check(NO_FLAGS, of(DeviceFlag.DISCONNECTED))

    assert ids_and_cases(found) == [("B1", Case.USUAL)]
    assert not watch.explains_silence


@pytest.mark.fault("B10")
def test_error_codes_have_different_cases() -> None:
    """A wrong request, a failed device and a busy device differ."""
    watch = BusWatch(0)
    request = watch.check(NO_FLAGS, of(DeviceFlag.WRONG_REQUEST))
    failure = watch.check(NO_FLAGS, of(DeviceFlag.DEVICE_FAILURE))
    for _ in range(5):
        busy = watch.check(NO_FLAGS, of(DeviceFlag.BUSY))

    assert ids_and_cases(request) == [("B10", Case.REQUEST)]
    assert ids_and_cases(failure) == [("B10", Case.USUAL)]
    assert ids_and_cases(busy) == [("B10", Case.BUSY)]


@pytest.mark.fault("S10")
def test_another_amplifier_is_worse_than_another_sensor() -> None:
    """An amplifier that is not the configured one must not be ramped."""
    other = of(DeviceFlag.OTHER_DEVICE)

    assert ids_and_cases(BusWatch(0).check(other, NO_FLAGS)) == [("S10", Case.USUAL)]
    assert ids_and_cases(BusWatch(0).check(NO_FLAGS, other)) == [("S10", Case.AMPLIFIER)]
    assert ids_and_cases(BusWatch(0).check(other, other)) == [("S10", Case.AMPLIFIER)]


@given(
    st.lists(
        st.tuples(
            st.frozensets(st.sampled_from(DeviceFlag)), st.frozensets(st.sampled_from(DeviceFlag))
        ),
        max_size=50,
    )
)
def test_flags_are_forgotten_after_ten_cycles_without(rounds: list[tuple[Flags, Flags]]) -> None:
    """Each detection is of this axis, for any flags."""
    watch = BusWatch(3)
    for sensor, amplifier in rounds:
        assert all(one.axis == 3 for one in watch.check(sensor, amplifier))
    for _ in range(10):
        watch.check(NO_FLAGS, NO_FLAGS)

    assert watch.check(NO_FLAGS, NO_FLAGS) == ()
