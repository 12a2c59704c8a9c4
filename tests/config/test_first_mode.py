"""The first mechanical mode of an axis."""

from collections.abc import Callable

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.config.first_mode import FirstModeConfig

ProblemsOf = Callable[..., list[str]]
LIMITS = "    command_range_um: [0, 26]"


def test_mode_is_not_known_unless_it_is_given(load: Callable[..., ExperimentConfig]) -> None:
    """The first mode is optional."""
    assert load().axes["x"].first_mode is None


def test_mode_is_read(load: Callable[..., ExperimentConfig]) -> None:
    """Both keys are read."""
    text = "first_mode: {frequency_hz: 734, damping: 0.015}"

    mode = load((LIMITS, f"{LIMITS}\n    {text}")).axes["x"].first_mode

    assert mode == FirstModeConfig(frequency_hz=734.0, damping=0.015)


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        (
            "{frequency_hz: 734}",
            "12:5: axes.x.first_mode.damping: required key is missing",
        ),
        (
            "{damping: 0.1}",
            "12:5: axes.x.first_mode.frequency_hz: required key is missing",
        ),
        (
            "{frequency_hz: 0.5, damping: 0.1}",
            "12:32: axes.x.first_mode.frequency_hz: out of range (got 0.5), "
            "allowed range 1 to 100000 Hz",
        ),
        (
            "{frequency_hz: 734, damping: 0}",
            "12:46: axes.x.first_mode.damping: out of range (got 0), allowed range 0.001 to 1",
        ),
    ],
)
def test_one_mistake(problems_of: ProblemsOf, mode: str, expected: str) -> None:
    """Each mistake gives one line with the place and the allowed values."""
    problems = problems_of((LIMITS, f"{LIMITS}\n    first_mode: {mode}"))

    assert problems == [f"test.yaml:{expected}"]
