"""Tests of the dynamics of an axis, as its control law uses them."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import pytest

from piezod.config.axes import AxisConfig
from piezod.config.modes import Mode
from piezod.config.response_file import ResponseFile
from piezod.control.law.dynamics import ModalMotion, known_dynamics
from piezod.control.law.trim_gains import check_feedback, feedback_law, margins_text
from piezod.dynamics import Resonance
from piezod.errors import ModelError
from piezod.units import NS_PER_S

PERIOD_S = 1e-4
MODE = {"frequency_hz": 734.0, "damping": 0.03}

trim_law, check_trim = partial(feedback_law, Mode.TRIMMED), partial(check_feedback, Mode.TRIMMED)


def response_of(*resonances: Mapping[str, float], delay_s: float = 0.235e-3) -> ResponseFile:
    """Return the contents of a response file."""
    return ResponseFile.model_validate(
        {
            "created_at": "2026-01-01T00:00:00+00:00",
            "created_by": "a test",
            "method": "multisine",
            "rate_hz": 10_000.0,
            "low_hz": 5.0,
            "high_hz": 2000.0,
            "coherence_low": 0.9,
            "coherence_high": 1.0,
            "delay_s": delay_s,
            "resonances": resonances,
        }
    )


def axis_of(response: ResponseFile | None, **trim: object) -> AxisConfig:
    """Return the configuration of an axis with a response."""
    return AxisConfig.model_validate(
        {
            "amplifier": {"device": "rig"},
            "sensor": {"device": "rig"},
            "limits": {"drive_min_v": 0, "drive_max_v": 150, "slew_v_per_s": 2e4, "rest_v": 0},
            "response": response,
            "trim": trim,
        }
    )


def modes_of(*resonances: Mapping[str, float]) -> Sequence[Resonance]:
    """Return the modes of an axis with these resonances."""
    dynamics = known_dynamics(axis_of(response_of(*resonances)), PERIOD_S)
    assert dynamics is not None
    return dynamics.modes


def test_without_a_response_nothing_is_known() -> None:
    """The law then uses the delay of the model and the first mode."""
    assert known_dynamics(axis_of(None), PERIOD_S) is None


def test_delay_is_that_between_straight_lines() -> None:
    """Half a period less than from the output; the mode adds its own delay for slow motion."""
    dynamics = known_dynamics(axis_of(response_of(MODE)), PERIOD_S)

    assert dynamics is not None
    assert dynamics.modes == (Resonance(734.0, 0.03),)
    assert dynamics.delay_s == pytest.approx(0.185e-3)
    assert dynamics.slow_delay_s == pytest.approx(0.185e-3 + 0.03 / (np.pi * 734.0))


def test_filter_counts_as_delay() -> None:
    """The whole delay for slow motion stays, and the mode makes all of the displacement."""
    behind = {"frequency_hz": 430.0, "damping": 0.73, "share": 1.29}
    dynamics = known_dynamics(axis_of(response_of(behind, {**MODE, "share": -0.29})), PERIOD_S)

    assert dynamics is not None
    assert dynamics.modes == (Resonance(734.0, 0.03),)
    whole_s = 0.185e-3 + 1.29 * 0.73 / (np.pi * 430.0) - 0.29 * 0.03 / (np.pi * 734.0)
    assert dynamics.slow_delay_s == pytest.approx(whole_s)


def test_shares_of_modes_are_those_before_the_filter() -> None:
    """A filter that passes less of the second mode has made its share smaller."""
    low_pass = {"frequency_hz": 1000.0, "damping": 0.8, "share": 1.0 - 0.6 + 0.1}
    first = {"frequency_hz": 300.0, "damping": 0.03, "share": 0.6}
    second = {"frequency_hz": 2000.0, "damping": 0.03, "share": -0.1}
    passed = np.abs(Resonance(1000.0, 0.8).at(np.array([300.0, 2000.0])))

    modes = modes_of(first, low_pass, second)

    assert sum(mode.share for mode in modes) == pytest.approx(1.0)
    assert modes[1].share / modes[0].share == pytest.approx(0.1 / passed[1] / (0.6 / passed[0]))


def test_filters_alone_are_no_modes() -> None:
    """Then there is nothing to invert."""
    assert modes_of({"frequency_hz": 430.0, "damping": 0.7}) == ()


def test_modal_motion_shows_in_a_sample_after_the_delay() -> None:
    """A held step rings around its end, as much as the mode overshoots."""
    period_ns, delay_ns = 100_000, 250_000
    motion = ModalMotion([Resonance(500.0, 0.02)], period_ns, delay_ns, 0.3)
    added = []
    for k in range(2000):
        motion.advance(k * period_ns, 0.3 if k < 5 else 1.3)
        added.append(motion.shown(k * period_ns))

    assert added[:7] == pytest.approx([0.0] * 7)  # the step ends at cycle 5, the delay at 7.5
    assert min(added[:10]) == pytest.approx(-0.5, abs=0.5)
    assert max(added) == pytest.approx(np.exp(-0.02 * np.pi), rel=0.05)
    assert abs(added[-1]) < 1e-3
    assert period_ns / NS_PER_S == PERIOD_S


def test_notches_are_at_the_modes_of_the_response() -> None:
    """Without a response, or if they are not wanted, there are none."""
    known = response_of(MODE)

    assert trim_law(axis_of(known), PERIOD_S, 0.0).notches == (Resonance(734.0, 0.03),)
    assert trim_law(axis_of(known, notch="none"), PERIOD_S, 0.0).notches == ()
    assert trim_law(axis_of(None), PERIOD_S, 0.0).notches == ()
    assert trim_law(axis_of(known), 1e-3, 0.0).notches == ()  # beyond the rate


def test_response_decides_which_gains_are_safe() -> None:
    """A notch allows a gain that is refused without it; the delay of the model does not count."""
    known = response_of(MODE)
    check_trim(axis_of(known, gain_per_s=800.0, proportional=0.2), PERIOD_S, 1.0)

    with pytest.raises(ModelError, match=r"use at most 98 1/s with a proportional gain of 0\.0245"):
        check_trim(axis_of(known, gain_per_s=800.0, proportional=0.2, notch="none"), PERIOD_S, 0.0)


def test_margins_are_told_with_a_proposal() -> None:
    """The proposal has the required margins."""
    text = margins_text(Mode.TRIMMED, axis_of(response_of(MODE), gain_per_s=600.0), PERIOD_S, 0.0)

    assert text.startswith("trim 600 1/s, notch at 734 Hz: gain margin 4.2")
    proposed = text.rpartition(": ")[2]
    gain, proportional = proposed.split(" 1/s with a proportional gain of ")
    check_trim(
        axis_of(response_of(MODE), gain_per_s=float(gain), proportional=float(proportional)),
        PERIOD_S,
        0.0,
    )
