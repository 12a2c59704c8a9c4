"""The keys of the trim of an axis."""

from collections.abc import Callable

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.config.trim import TrimConfig

ProblemsOf = Callable[..., list[str]]
LIMITS = "    command_range_um: [0, 26]"


def test_trim_has_defaults(load: Callable[..., ExperimentConfig]) -> None:
    """An axis that says nothing of the trim has one that suits a 1 kHz loop."""
    trim = load().axes["x"].trim

    assert trim == TrimConfig(base="feedforward", gain_per_s=50.0, authority_pct=5.0)
    assert (trim.first_mode_hz, trim.first_mode_damping) == (None, None)


def test_trim_is_read(load: Callable[..., ExperimentConfig]) -> None:
    """Each key arrives."""
    text = (
        "trim: {base: adaptive, gain_per_s: 20, authority_pct: 2, "
        "first_mode_hz: 734, first_mode_damping: 0.015}"
    )

    trim = load((LIMITS, f"{LIMITS}\n    {text}")).axes["x"].trim

    assert trim == TrimConfig(
        base="adaptive",
        gain_per_s=20.0,
        authority_pct=2.0,
        first_mode_hz=734.0,
        first_mode_damping=0.015,
    )


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
        (
            "{first_mode_hz: 734}",
            "12:27: axes.x.trim.first_mode_hz: needs first_mode_damping too, give both or none",
        ),
        (
            "{first_mode_damping: 0.1}",
            "12:32: axes.x.trim.first_mode_damping: needs first_mode_hz too, give both or none",
        ),
        (
            "{first_mode_hz: 734, first_mode_damping: 0}",
            "12:52: axes.x.trim.first_mode_damping: out of range (got 0), allowed range 0.001 to 1",
        ),
    ],
)
def test_one_mistake(problems_of: ProblemsOf, trim: str, expected: str) -> None:
    """Each mistake is one line that says where it is and what would be right."""
    problems = problems_of((LIMITS, f"{LIMITS}\n    trim: {trim}"))

    assert problems == [f"test.yaml:{expected}"]
