"""The keys of the trim of an axis."""

from collections.abc import Callable

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.config.trim import TrimConfig

ProblemsOf = Callable[..., list[str]]
LIMITS = "    command_range_um: [0, 26]"


def test_trim_has_defaults(load: Callable[..., ExperimentConfig]) -> None:
    """The gain is left to the stage: it depends on its mode and delay."""
    trim = load().axes["x"].trim

    assert trim == TrimConfig(base="feedforward", gain_per_s=None, authority_pct=5.0)


def test_trim_is_read(load: Callable[..., ExperimentConfig]) -> None:
    """Each key is read."""
    text = "trim: {base: adaptive, gain_per_s: 20, authority_pct: 2}"

    trim = load((LIMITS, f"{LIMITS}\n    {text}")).axes["x"].trim

    assert trim == TrimConfig(base="adaptive", gain_per_s=20.0, authority_pct=2.0)


@pytest.mark.parametrize(
    ("trim", "expected"),
    [
        (
            "{base: trimmed}",
            "12:18: axes.x.trim.base: unknown value (got 'trimmed'), "
            "allowed: feedforward, adaptive",
        ),
        (
            "{gain_per_s: 0}",
            "12:24: axes.x.trim.gain_per_s: out of range (got 0), allowed range 0.01 to 5000 1/s",
        ),
        (
            "{authority_pct: 21}",
            "12:27: axes.x.trim.authority_pct: out of range (got 21), allowed range 0.1 to 20 %",
        ),
    ],
)
def test_one_mistake(problems_of: ProblemsOf, trim: str, expected: str) -> None:
    """Each mistake gives one line with the place and the allowed values."""
    problems = problems_of((LIMITS, f"{LIMITS}\n    trim: {trim}"))

    assert problems == [f"test.yaml:{expected}"]
