"""Learning on a simulated stage whose gain grows."""

from typing import Final

import pytest

from piezod.experiment.play.learn import LearnedPlay, learn
from piezod.experiment.play.task import KnownAxis, PlaySettings
from tests.experiment.play.rig_axis import (
    SENSOR_DELAY_S,
    RigAxis,
    known_response,
    maker,
    model,
    sine,
)

SETTINGS: Final = PlaySettings(passes=8, settle_s=0.3, record_s=0.2)
GROWTH_PER_S: Final = 1e-3
"""0.11 % from one play to the next."""


def learned(growth_per_s: float) -> list[LearnedPlay]:
    """Learn two sines, one after the other, on a stage whose gain grows from now on."""
    axis = RigAxis()
    axis.use(stage={"gain_growth_per_s": growth_per_s})
    known = KnownAxis(maker(), model().creep, known_response(), SENSOR_DELAY_S)
    commands = sine(200.0), sine(100.0, 6.0, 26.0)
    return [learn(axis, known.task(each, SETTINGS), lambda _: None) for each in commands]


def test_growing_gain_is_foreseen_and_carried_over() -> None:
    """The best error is that of a constant stage, and so is the first of the second sine."""
    constant, growing = (learned(each) for each in (0.0, GROWTH_PER_S))

    for one, other in zip(constant, growing, strict=True):
        assert other.best.measured.rms_pct == pytest.approx(one.best.measured.rms_pct, abs=0.03)
    (_, first), (_, second) = constant, growing
    assert second.reports[0].measured.rms_pct < first.reports[0].measured.rms_pct + 0.06
