"""Tests that learning makes no motion worse, at any delay of the samples, rate and frequency."""

from typing import Final

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import CaseConfig
from piezod.config.modes import Mode
from piezod.config.waveforms.combined import Sequence
from piezod.experiment.virtual.run import run_experiment
from tests.conftest import Figure
from tests.experiment.beyond import experiment_of

FREQUENCIES_HZ: Final = (0.5, 5.0, 20.0, 50.0)
LARGEST_LOSS_PCT: Final = {"stack": 0.02, "no-antialias": 1.5}
"""By this much more, in % of the range, `adaptive` may be wrong than `feedforward`. Without a
filter the first mode, which rings between two cycles, and the noise are aliased into samples."""
_PARTS_S: Final = (2.0, 5.0, 6.0, 1.0)
_DELAYS_S: Final = {"stack": 0.00063, "no-antialias": 0.00013}
"""Part of the delay that lies in the sensor, without the additional one."""


def experiment(
    variant: str, rate_hz: float, cycles: float, frequencies_hz: tuple[float, ...]
) -> ExperimentConfig:
    """Return an experiment with a sine of each frequency, whose samples are later by some cycles.

    Without a filter, samples behind a held voltage have a delay of about half a cycle less than
    none.
    """
    later_s = cycles / rate_hz
    config = experiment_of(variant, sensor={"delay_s": 0.00011 + later_s})
    axis, identification = config.axes["x"], config.identification
    assert identification is not None
    assert isinstance(identification.drive_v, Sequence)
    delay = {"sensor_delay_s": _DELAYS_S[variant] + later_s}
    compensator = axis.compensator.model_copy(update=delay)
    parts = tuple(
        part.model_copy(update={"duration_s": duration_s})
        for part, duration_s in zip(identification.drive_v.parts, _PARTS_S, strict=True)
    )
    shorter = {
        "run_in_s": _PARTS_S[0],
        "duration_s": sum(_PARTS_S),
        "drive_v": identification.drive_v.model_copy(update={"parts": parts}),
    }
    return config.model_copy(
        update={
            "rate_hz": rate_hz,
            "axes": {"x": axis.model_copy(update={"compensator": compensator})},
            "identification": identification.model_copy(update=shorter),
            "settle_s": 1.0,
            "modes": (Mode.FEEDFORWARD, Mode.ADAPTIVE),
            "cases": tuple(_case(frequency_hz) for frequency_hz in frequencies_hz),
        }
    )


def _case(frequency_hz: float) -> CaseConfig:
    sine = {"kind": "sine", "low": 2.0, "high": 22.0, "frequency_hz": frequency_hz}
    period_s = max(1.0, 1.0 / frequency_hz)
    return CaseConfig.model_validate(
        {
            "name": f"{frequency_hz:g} Hz",
            "period_s": period_s,
            "duration_s": 2.0 * period_s,
            "command_um": {
                "kind": "sequence",
                "parts": (
                    {
                        "duration_s": 0.5 * period_s,
                        "waveform": {"kind": "setpoint", "level": 2.0},
                    },
                    {"duration_s": 1.5 * period_s, "waveform": sine},
                ),
            },
        }
    )


_ALL: Final = [
    pytest.param(variant, rate_hz, cycles, FREQUENCIES_HZ, marks=pytest.mark.stress)
    for variant in _DELAYS_S
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
    result = run_experiment(config, "", "", lambda _label, _share: None)

    worst_pct = {
        (each.case, each.mode): each.metrics["true_tracking_max_pct"] for each in result.recordings
    }
    lost_pct = []
    for case in config.cases:
        without, learning = (
            worst_pct[case.name, mode.value] for mode in (Mode.FEEDFORWARD, Mode.ADAPTIVE)
        )
        lost_pct.append(learning - without)
        figure(
            f"{variant}, {rate_hz:g} Hz, {cycles:g} cycles later, {case.name}: feedforward "
            f"{without:.2f} %, adaptive {learning:.2f} %"
        )
    assert max(lost_pct) <= LARGEST_LOSS_PCT[variant]
