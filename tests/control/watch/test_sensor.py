"""Tests of the watch of the sensor, on a stage in proportion; others use the rig."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.control.watch.sensor import SensorWatch, WatchedSensor
from piezod.devices.interface import Sample
from piezod.devices.status import DeviceFlag
from tests.conftest import Reaction
from tests.control.fakes import MS
from tests.control.watched_stage import (
    DRIVE_V,
    POSITION_UM,
    Disturb,
    WatchInput,
    at_rest_v,
    measured,
    run_watch,
    sine_v,
    watch,
)

START = 4000
"""First cycle of most faults; the drive rises fastest in cycle 4250."""


def test_healthy_sensor_has_no_fault() -> None:
    """This holds in motion and at rest, and every sample is used unchanged."""
    moving, resting = run_watch(measured(8000)), run_watch(measured(8000, at_rest_v))

    assert moving.all_ids == resting.all_ids == set()
    assert moving.samples == [inputs.sample for inputs in measured(8000)]


@pytest.mark.stress
def test_a_million_idle_cycles_are_no_fault() -> None:
    """Noise alone is no spike, no jump, no stuck sensor, and not noisier than usual."""
    subject = watch()
    for inputs in measured(1_000_000, at_rest_v):
        t_ns, sample, in_force_v, flags, driven, needed = inputs
        assert not subject.check(
            t_ns, sample, flags, in_force_v, math.nan, driven=driven, needed=needed
        )


@pytest.mark.fault("S1")
@pytest.mark.parametrize("start", range(4010, 5000, 97))
def test_stuck_sensor_is_detected_anywhere(start: int) -> None:
    """S1 comes when the drive has moved by 2 % of its range, after twenty samples at least."""
    last_um = [inputs.sample.position_um for inputs in measured(start)][-1]
    seen = run_watch(
        measured(6000), lambda k, inputs: inputs.showing(last_um) if k >= start else inputs
    )

    drive_v = [sine_v(k) for k in range(start - 1, start + 200)]
    moved = [max(drive_v[:k]) - min(drive_v[:k]) > 3.0 for k in range(1, 200)]
    assert seen.first("S1") == start - 1 + max(19, moved.index(True))
    assert seen.all_ids <= {"S1", "S9", "S13"}


@pytest.mark.fault("S1")
@pytest.mark.fault("S13")
def test_stuck_sensor_that_no_mode_needs_is_a_warning() -> None:
    """In feedforward S13 replaces S1."""

    def stuck(k: int, inputs: WatchInput) -> WatchInput:
        inputs = inputs._replace(needed=False)
        return inputs.showing(12.0) if k >= START else inputs

    assert "S1" not in run_watch(measured(5000), stuck).all_ids
    assert "S13" in run_watch(measured(5000), stuck).all_ids


@pytest.mark.fault("S13")
def test_constant_sensor_at_rest_is_detected(reaction: Reaction) -> None:
    """S13 comes after 200 equal samples, unless the sensor never had any noise."""
    still = run_watch(measured(5000, at_rest_v), lambda k, t: t.showing(15.0) if k >= START else t)
    silent = run_watch(measured(5000, at_rest_v), lambda _k, inputs: inputs.showing(15.0))

    assert still.first("S13") == START + 199
    reaction("S13", cycles=still.first("S13") + 1 - START)
    assert silent.all_ids == set()


@pytest.mark.fault("S2")
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite_are_dropped_and_detected(value: float) -> None:
    """The first is dropped already; the fourth is S2."""
    seen = run_watch(
        measured(START + 10), lambda k, inputs: inputs.showing(value) if k >= START else inputs
    )

    assert seen.first("S2") == START + 3
    assert not any(sample.valid for sample in seen.samples[START:])
    assert seen.all_ids == {"S2"}


@pytest.mark.fault("S2")
def test_nan_in_every_second_sample_is_detected() -> None:
    """The bucket trips, and the samples in between are used."""

    def alternating(k: int, inputs: WatchInput) -> WatchInput:
        return inputs.showing(math.nan) if k >= START and k % 2 == 0 else inputs

    seen = run_watch(measured(START + 40), alternating)
    assert START + 10 < seen.first("S2") < START + 25
    assert all(sample.valid == (k % 2 == 1) for k, sample in enumerate(seen.samples) if k >= START)


@pytest.mark.fault("S3")
@pytest.mark.parametrize("value", [-6.1, 36.1, 1e300])
def test_three_values_out_of_range_are_detected(value: float) -> None:
    """They are more than 20 % outside the range, and none is used."""
    seen = run_watch(
        measured(START + 10), lambda k, inputs: inputs.showing(value) if k >= START else inputs
    )

    assert seen.first("S3") == START + 2
    assert not any(sample.valid for sample in seen.samples[START:])
    assert seen.faults[-1][0].measured == value


def test_any_position_is_valid_while_the_stage_is_not_driven() -> None:
    """The sensor may not be zeroed yet, and zeroing needs its samples."""
    seen = run_watch(
        measured(START, at_rest_v),
        lambda _k, inputs: inputs._replace(driven=False).showing(
            inputs.sample.position_um + 5000.0
        ),
    )

    assert seen.all_ids == set()
    assert all(sample.valid for sample in seen.samples)


@pytest.mark.fault("S4")
@pytest.mark.parametrize("length", [1, 2])
def test_spikes_are_dropped(length: int) -> None:
    """One or two samples are dropped, and no others."""

    def spiky(k: int, inputs: WatchInput) -> WatchInput:
        return (
            inputs.showing(inputs.sample.position_um + 6.0) if 0 <= k - START < length else inputs
        )

    seen = run_watch(measured(5000), spiky)
    assert [k for k in range(5000) if seen.faults[k]] == list(range(START, START + length))
    assert seen.all_ids == {"S4"}
    spikes = [k for k, subject in enumerate(seen.samples) if not subject.valid]
    assert spikes == list(range(START, START + length))


@pytest.mark.fault("S4")
@pytest.mark.fault("S9")
@pytest.mark.parametrize("step_um", [-6.0, 6.0])
def test_step_of_the_sensor_is_detected_with_its_third_sample(step_um: float) -> None:
    """A step of 6 µm of 30, up or down, is S9 while the drive rests."""
    seen = run_watch(
        measured(5000, at_rest_v),
        lambda k, inputs: (
            inputs.showing(inputs.sample.position_um + step_um) if k >= START else inputs
        ),
    )

    assert [seen.ids(k) for k in range(START, START + 4)] == [["S4"], ["S4"], ["S9"], []]


@pytest.mark.fault("S5")
@pytest.mark.parametrize(("gap", "is_found"), [(1, False), (3, False), (4, True), (1000, True)])
def test_gap_is_detected_from_the_fourth_sample_on(gap: int, is_found: bool) -> None:
    """The fault ends when samples return."""

    def dropped(k: int, inputs: WatchInput) -> WatchInput:
        lost = inputs.sample._replace(valid=False)
        return inputs._replace(sample=lost) if START <= k < START + gap else inputs

    seen = run_watch(measured(START + 1200), dropped)
    assert seen.first("S5") == (START + 3 if is_found else -1)
    assert seen.ids(START + gap) == []
    assert seen.all_ids <= {"S5"}


@pytest.mark.fault("S6")
def test_late_samples_are_detected_and_used() -> None:
    """They are 2 ms old for twenty cycles; the gate does not learn from them."""

    def late(k: int, inputs: WatchInput) -> WatchInput:
        old = inputs.sample._replace(t_ns=inputs.t_ns - 2 * MS)
        return inputs._replace(sample=old) if k >= START else inputs

    seen = run_watch(measured(START + 100), late)
    assert START + 19 <= seen.first("S6") <= START + 22
    assert all(sample.valid for sample in seen.samples[START + 3 :])


@pytest.mark.fault("S6")
@pytest.mark.fault("S5")
def test_samples_that_are_too_late_count_as_missing() -> None:
    """New samples that are 10 ms old are not used."""

    def late(k: int, inputs: WatchInput) -> WatchInput:
        old = inputs.sample._replace(t_ns=inputs.t_ns - 10 * MS)
        return inputs._replace(sample=old) if k >= START else inputs

    seen = run_watch(measured(START + 100), late)
    assert 0 < seen.first("S5") <= START + 15
    assert not any(sample.valid for sample in seen.samples[START:])


@pytest.mark.fault("S7")
@pytest.mark.fault("S8")
@pytest.mark.parametrize(
    ("flag", "fault"), [(DeviceFlag.SATURATED, "S7"), (DeviceFlag.LOW_LIGHT, "S8")]
)
def test_samples_with_a_flag_are_not_used(flag: DeviceFlag, fault: str, reaction: Reaction) -> None:
    """The third flag in a row is a fault, however plausible the samples are."""

    def flagged(k: int, inputs: WatchInput) -> WatchInput:
        return inputs._replace(flags=frozenset({flag})) if k >= START else inputs

    seen = run_watch(measured(START + 50), flagged)
    assert seen.first(fault) == START + 2
    reaction(fault, cycles=seen.first(fault) + 1 - START)
    assert not any(sample.valid for sample in seen.samples[START:])
    assert seen.all_ids == {fault}


@pytest.mark.fault("S9")
def test_motion_against_the_drive_is_detected_without_a_model() -> None:
    """It takes three strides against the drive, each of 2 % of its range."""
    seen = run_watch(
        measured(6000), lambda _k, inputs: inputs.showing(30.0 - inputs.sample.position_um)
    )

    assert 0 < seen.first("S9") < 400
    assert seen.all_ids == {"S9"}


@pytest.mark.fault("S11")
def test_repeated_sample_is_detected() -> None:
    """Its time stamp stands still; single repetitions are only dropped."""
    first = Sample(START * MS, 15.0, True)
    seen = run_watch(
        measured(START + 50), lambda k, t: t._replace(sample=first) if k >= START else t
    )
    now_and_then = run_watch(
        measured(START, at_rest_v),
        lambda k, inputs: (
            inputs._replace(sample=inputs.sample._replace(t_ns=inputs.t_ns - MS))
            if k % 10 == 9
            else inputs
        ),
    )

    assert seen.first("S11") == START + 3
    assert now_and_then.all_ids == set()
    assert [k % 10 for k, subject in enumerate(now_and_then.samples) if not subject.valid] == [
        9
    ] * 400


@pytest.mark.fault("S11")
@settings(max_examples=20)
@given(st.permutations(list(range(8))))
def test_samples_out_of_order_are_dropped(order: list[int]) -> None:
    """The time stamps of the used samples increase."""

    def permuted(k: int, inputs: WatchInput) -> WatchInput:
        t_ns = (k // 8 * 8 + order[k % 8] + 1) * MS
        return inputs._replace(sample=inputs.sample._replace(t_ns=min(t_ns, inputs.t_ns)))

    times = [
        subject.t_ns
        for subject in run_watch(measured(80, at_rest_v), permuted).samples
        if subject.valid
    ]
    assert times == sorted(set(times))


@pytest.mark.fault("S12")
@pytest.mark.parametrize("moving", [False, True])
def test_tenfold_noise_is_detected_within_a_second(moving: bool) -> None:
    """This holds at rest and in motion; doubled noise is no fault."""
    noise_um = np.random.default_rng(2).normal(0.0, 1.0, 12_000).tolist()
    drive_v = sine_v if moving else at_rest_v

    def noisier(by_um: float) -> Disturb:
        def disturb(k: int, inputs: WatchInput) -> WatchInput:
            if k < 10_000:
                return inputs
            return inputs.showing(inputs.sample.position_um + by_um * noise_um[k])

        return disturb

    tenfold = run_watch(measured(12_000, drive_v), noisier(0.18))
    doubled = run_watch(measured(12_000, drive_v), noisier(0.03))
    assert 10_000 < tenfold.first("S12") < 11_000
    assert "S12" not in doubled.all_ids


@given(st.lists(st.tuples(st.floats(), st.integers(-(2**62), 2**62), st.booleans()), max_size=40))
def test_no_sample_raises_and_used_samples_are_finite(
    samples: list[tuple[float, int, bool]],
) -> None:
    """A device may return anything."""
    subject: SensorWatch = watch(WatchedSensor(DRIVE_V, POSITION_UM))
    for k, (position_um, t_ns, valid) in enumerate(samples):
        sample = Sample(t_ns, position_um, valid)
        subject.check(k * MS, sample, frozenset(), 75.0, math.nan, driven=True, needed=True)
        assert not subject.sample.valid or math.isfinite(subject.sample.position_um)
