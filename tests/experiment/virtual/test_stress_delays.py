"""Tests that learning makes no motion worse, at any delay of the samples, rate and frequency."""

from typing import Final

import pytest

from piezod.config.modes import Mode
from tests.conftest import Figure
from tests.experiment.delayed import FREQUENCIES_HZ, SENSORS, errors_of, experiment

LARGEST_LOSS_PCT: Final = {"stack": 0.1, "no-antialias": 0.2}
"""By this much more, in % of the range, `adaptive` may be wrong than `feedforward` with a model of
14 s: what it has rightly learned at 0.5 Hz is not all right at 5 Hz. The model of a whole
identification differs less. Without a filter more noise is in the samples."""

_ALL: Final = [
    pytest.param(variant, rate_hz, cycles, FREQUENCIES_HZ, marks=pytest.mark.stress)
    for variant in SENSORS
    for rate_hz in (1000.0, 10_000.0)
    for cycles in (0.0, 0.5, 1.0, 1.75)
]


@pytest.mark.parametrize(
    ("variant", "rate_hz", "cycles", "frequencies_hz"),
    [("no-antialias", 1000.0, 0.0, (5.0,)), *_ALL],
)
def test_adaptive_is_never_worse_than_feedforward(
    figure: Figure, variant: str, rate_hz: float, cycles: float, frequencies_hz: tuple[float, ...]
) -> None:
    """With the sensor filtered or not; true worst errors in % of the range."""
    config = experiment(variant, rate_hz, cycles, frequencies_hz)
    worst_pct = errors_of(config).worst_pct

    lost_pct = []
    for case in config.cases:
        without, learning = (
            worst_pct[case.name, mode] for mode in (Mode.FEEDFORWARD, Mode.ADAPTIVE)
        )
        lost_pct.append(learning - without)
        figure(
            f"{variant}, {rate_hz:g} Hz, {cycles:g} cycles later, {case.name}: feedforward "
            f"{without:.2f} %, adaptive {learning:.2f} %"
        )
    assert max(lost_pct) <= LARGEST_LOSS_PCT[variant]
