"""The experiment on fast waveforms, on the simulated stages."""

import pytest

from benchmarks.fast_stages import COLUMNS, largest_pct
from tests.conftest import Figure

LARGEST_TRUE_PCT, LARGEST_UNLEARNED_PCT = 0.105, 2.0
STAGES = (
    "stack",
    "preisach-exponential",
    "preisach-gaussian",
    "preisach-asymmetric",
    "afm",
    "flexure",
    "light-damping",
    "thermal-relays",
    "gain-drift",
    "bouc-wen",
)


@pytest.mark.stress
@pytest.mark.parametrize("stage", STAGES)
def test_waveforms_up_to_200_hz_are_learned(stage: str, figure: Figure) -> None:
    """The true error of all waveforms is at most 0.1 % of the swing, and 2 % before learning."""
    errors_pct = dict(zip(COLUMNS, largest_pct(stage, 1), strict=True))

    figure(f"{stage}: " + ", ".join(f"{name} {value:.3f} %" for name, value in errors_pct.items()))
    assert errors_pct["true"] <= LARGEST_TRUE_PCT
    assert errors_pct["unlearned"] <= LARGEST_UNLEARNED_PCT
    assert errors_pct["measured"] <= 2.0 * LARGEST_TRUE_PCT
