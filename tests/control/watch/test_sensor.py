"""Tests of what is said of a sensor, on a stage in proportion; those on the rig are elsewhere."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.control.watch.sensor import SensorWatch, WatchedSensor
from piezod.devices.interface import Sample
from piezod.devices.status import DeviceFlag
from tests.control.fakes import MS
from tests.control.watched_stage import (
    DRIVE_V,
    POSITION_UM,
    Disturb,
    Told,
    at_rest_v,
    measured,
    see,
    sine_v,
    watch,
)

START = 4000
"""The cycle in which most faults begin: the drive rises fastest in 4250."""


def test_nothing_is_found_in_a_healthy_sensor() -> None:
    """Neither in motion nor at rest, and every sample is used as it is."""
    moving, resting = see(measured(8000)), see(measured(8000, at_rest_v))

    assert moving.all_ids == resting.all_ids == set()
    assert moving.samples == [told.sample for told in measured(8000)]


@pytest.mark.stress
@pytest.mark.fault("S1")
def test_a_million_idle_cycles_are_no_fault() -> None:
    """Noise alone is no spike, no jump, no stuck sensor, and not noisier than itself."""
    one = watch()
    for told in measured(1_000_000, at_rest_v):
        t_ns, sample, in_force_v, flags, driven, needed = told
        assert not one.check(
            t_ns, sample, flags, in_force_v, math.nan, driven=driven, needed=needed
        )


@pytest.mark.fault("S1")
@pytest.mark.parametrize("start", range(4010, 5000, 97))
def test_a_stuck_sensor_is_told_wherever_it_sticks(start: int) -> None:
    """As soon as the drive has moved by 2 % of its range, and after twenty samples at least."""
    last_um = [told.sample.position_um for told in measured(start)][-1]
    seen = see(measured(6000), lambda k, told: told.showing(last_um) if k >= start else told)

    drive_v = [sine_v(k) for k in range(start - 1, start + 200)]
    moved = [max(drive_v[:k]) - min(drive_v[:k]) > 3.0 for k in range(1, 200)]
    assert seen.first("S1") == start - 1 + max(19, moved.index(True))
    assert seen.all_ids <= {"S1", "S9", "S13"}


@pytest.mark.fault("S1")
@pytest.mark.fault("S13")
def test_a_stuck_sensor_that_nothing_needs_is_a_warning() -> None:
    """In feedforward it is S13 instead of S1."""

    def stuck(k: int, told: Told) -> Told:
        told = told._replace(needed=False)
        return told.showing(12.0) if k >= START else told

    assert "S1" not in see(measured(5000), stuck).all_ids
    assert "S13" in see(measured(5000), stuck).all_ids


@pytest.mark.fault("S13")
def test_a_sensor_that_stands_still_at_rest_is_told() -> None:
    """After two hundred samples that are the same; one that never had any noise may do so."""
    still = see(measured(5000, at_rest_v), lambda k, t: t.showing(15.0) if k >= START else t)
    silent = see(measured(5000, at_rest_v), lambda _k, told: told.showing(15.0))

    assert still.first("S13") == START + 199
    assert silent.all_ids == set()


@pytest.mark.fault("S2")
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_no_numbers_are_not_used_and_told_within_five_cycles(value: float) -> None:
    """The first is left out, the fourth is told."""
    seen = see(measured(START + 10), lambda k, told: told.showing(value) if k >= START else told)

    assert seen.first("S2") == START + 3
    assert not any(sample.valid for sample in seen.samples[START:])
    assert seen.all_ids == {"S2"}


@pytest.mark.fault("S2")
def test_every_second_value_no_number_is_told_too() -> None:
    """The bucket of five fills, and what is in between is used."""

    def alternating(k: int, told: Told) -> Told:
        return told.showing(math.nan) if k >= START and k % 2 == 0 else told

    seen = see(measured(START + 40), alternating)
    assert START + 10 < seen.first("S2") < START + 25
    assert all(sample.valid == (k % 2 == 1) for k, sample in enumerate(seen.samples) if k >= START)


@pytest.mark.fault("S3")
@pytest.mark.parametrize("value", [-6.1, 36.1, 1e300])
def test_three_values_out_of_range_are_told(value: float) -> None:
    """20 % beyond the range; not one of them is used."""
    seen = see(measured(START + 10), lambda k, told: told.showing(value) if k >= START else told)

    assert seen.first("S3") == START + 2
    assert not any(sample.valid for sample in seen.samples[START:])
    assert seen.faults[-1][0].measured == value


def test_a_stage_that_is_not_driven_may_not_be_zeroed_yet() -> None:
    """Its samples are valid, wherever they are: zeroing needs them."""
    seen = see(
        measured(START, at_rest_v),
        lambda _k, told: told._replace(driven=False).showing(told.sample.position_um + 5000.0),
    )

    assert seen.all_ids == set()
    assert all(sample.valid for sample in seen.samples)


@pytest.mark.fault("S4")
@pytest.mark.parametrize("length", [1, 2])
def test_spikes_are_left_out(length: int) -> None:
    """One sample or two; before and after them all is well."""

    def spiky(k: int, told: Told) -> Told:
        return told.showing(told.sample.position_um + 6.0) if 0 <= k - START < length else told

    seen = see(measured(5000), spiky)
    assert [k for k in range(5000) if seen.faults[k]] == list(range(START, START + length))
    assert seen.all_ids == {"S4"}
    spikes = [k for k, one in enumerate(seen.samples) if not one.valid]
    assert spikes == list(range(START, START + length))


@pytest.mark.fault("S4")
@pytest.mark.fault("S9")
@pytest.mark.parametrize("step_um", [-6.0, 6.0])
def test_a_step_of_the_sensor_is_implausible_with_its_third_sample(step_um: float) -> None:
    """6 µm of 30, up or down, while the drive rests."""
    seen = see(
        measured(5000, at_rest_v),
        lambda k, told: told.showing(told.sample.position_um + step_um) if k >= START else told,
    )

    assert [seen.ids(k) for k in range(START, START + 4)] == [["S4"], ["S4"], ["S9"], []]


@pytest.mark.fault("S5")
@pytest.mark.parametrize(("gap", "is_found"), [(1, False), (3, False), (4, True), (1000, True)])
def test_a_gap_is_told_from_the_fourth_sample_on(gap: int, is_found: bool) -> None:
    """And no more once samples come again."""

    def dropped(k: int, told: Told) -> Told:
        lost = told.sample._replace(valid=False)
        return told._replace(sample=lost) if START <= k < START + gap else told

    seen = see(measured(START + 1200), dropped)
    assert seen.first("S5") == (START + 3 if is_found else -1)
    assert seen.ids(START + gap) == []
    assert seen.all_ids <= {"S5"}


@pytest.mark.fault("S6")
def test_samples_that_stay_late_are_told_and_used() -> None:
    """2 ms old for twenty cycles; the gate keeps them from teaching."""

    def late(k: int, told: Told) -> Told:
        old = told.sample._replace(t_ns=told.t_ns - 2 * MS)
        return told._replace(sample=old) if k >= START else told

    seen = see(measured(START + 100), late)
    assert START + 19 <= seen.first("S6") <= START + 22
    assert all(sample.valid for sample in seen.samples[START + 3 :])


@pytest.mark.fault("S6")
@pytest.mark.fault("S5")
def test_samples_that_are_too_late_are_as_good_as_none() -> None:
    """Fresh arrivals, 10 ms old."""

    def late(k: int, told: Told) -> Told:
        old = told.sample._replace(t_ns=told.t_ns - 10 * MS)
        return told._replace(sample=old) if k >= START else told

    seen = see(measured(START + 100), late)
    assert 0 < seen.first("S5") <= START + 15
    assert not any(sample.valid for sample in seen.samples[START:])


@pytest.mark.fault("S7")
@pytest.mark.fault("S8")
@pytest.mark.parametrize(
    ("flag", "fault"), [(DeviceFlag.SATURATED, "S7"), (DeviceFlag.LOW_LIGHT, "S8")]
)
def test_what_a_sensor_says_of_itself_counts(flag: DeviceFlag, fault: str) -> None:
    """However plausible its samples are, none is used; the third in a row is told."""

    def flagged(k: int, told: Told) -> Told:
        return told._replace(flags=frozenset({flag})) if k >= START else told

    seen = see(measured(START + 50), flagged)
    assert seen.first(fault) == START + 2
    assert not any(sample.valid for sample in seen.samples[START:])
    assert seen.all_ids == {fault}


@pytest.mark.fault("S9")
def test_a_stage_that_goes_the_wrong_way_is_implausible_without_a_model() -> None:
    """Three strides against the drive, each of 2 % of its range."""
    seen = see(measured(6000), lambda _k, told: told.showing(30.0 - told.sample.position_um))

    assert 0 < seen.first("S9") < 400
    assert seen.all_ids == {"S9"}


@pytest.mark.fault("S11")
def test_the_same_sample_again_and_again_is_told() -> None:
    """Its time stands still; single ones are only left out."""
    first = Sample(START * MS, 15.0, True)
    seen = see(measured(START + 50), lambda k, t: t._replace(sample=first) if k >= START else t)
    now_and_then = see(
        measured(START, at_rest_v),
        lambda k, told: (
            told._replace(sample=told.sample._replace(t_ns=told.t_ns - MS)) if k % 10 == 9 else told
        ),
    )

    assert seen.first("S11") == START + 3
    assert now_and_then.all_ids == set()
    assert [k % 10 for k, one in enumerate(now_and_then.samples) if not one.valid] == [9] * 400


@pytest.mark.fault("S11")
@settings(max_examples=20)
@given(st.permutations(list(range(8))))
def test_of_samples_out_of_order_only_the_latest_count(order: list[int]) -> None:
    """What is used of a permuted stream has times that increase."""

    def permuted(k: int, told: Told) -> Told:
        t_ns = (k // 8 * 8 + order[k % 8] + 1) * MS
        return told._replace(sample=told.sample._replace(t_ns=min(t_ns, told.t_ns)))

    times = [one.t_ns for one in see(measured(80, at_rest_v), permuted).samples if one.valid]
    assert times == sorted(set(times))


@pytest.mark.fault("S12")
@pytest.mark.parametrize("moving", [False, True])
def test_noise_that_has_grown_tenfold_is_told_within_a_second(moving: bool) -> None:
    """At rest and in motion; noise that has doubled is nobody's business."""
    noise_um = np.random.default_rng(2).normal(0.0, 1.0, 12_000).tolist()
    drive_v = sine_v if moving else at_rest_v

    def noisier(by_um: float) -> Disturb:
        def disturb(k: int, told: Told) -> Told:
            if k < 10_000:
                return told
            return told.showing(told.sample.position_um + by_um * noise_um[k])

        return disturb

    tenfold = see(measured(12_000, drive_v), noisier(0.18))
    doubled = see(measured(12_000, drive_v), noisier(0.03))
    assert 10_000 < tenfold.first("S12") < 11_000
    assert "S12" not in doubled.all_ids


@given(st.lists(st.tuples(st.floats(), st.integers(-(2**62), 2**62), st.booleans()), max_size=40))
def test_no_sample_raises_and_what_is_used_is_finite(
    samples: list[tuple[float, int, bool]],
) -> None:
    """Whatever a device gives."""
    one: SensorWatch = watch(WatchedSensor(DRIVE_V, POSITION_UM))
    for k, (position_um, t_ns, valid) in enumerate(samples):
        sample = Sample(t_ns, position_um, valid)
        one.check(k * MS, sample, frozenset(), 75.0, math.nan, driven=True, needed=True)
        assert not one.sample.valid or math.isfinite(one.sample.position_um)
