"""Sines on the stack, whose samples are later by some cycles, in each mode from the same state."""

from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import CaseConfig
from piezod.config.modes import Mode
from piezod.config.waveforms.combined import Sequence
from piezod.control.law.compensated import in_loop
from piezod.experiment.virtual.case import run_case
from piezod.experiment.virtual.creeping import Creeping
from piezod.experiment.virtual.identify import IdentifiedAxis, identify_axes
from piezod.experiment.virtual.stage import IN_FORCE_V, POSITION_UM, opened
from tests.experiment.beyond import experiment_of

FREQUENCIES_HZ: Final = (0.5, 5.0, 20.0, 50.0)
SENSORS: Final = {"stack": 0.00063, "no-antialias": 0.00013}
"""Variant → part of the delay that lies in its sensor, without the additional one, in s: with its
filter at 500 Hz, and without."""
_SWEEPS_S: Final = 4.0
"""Duration of the swings of the whole range before the cases."""
_PARTS_S: Final = (2.0, 5.0, 6.0, 1.0)
"""Durations of the parts of a short identification: at 10 kHz it has as many samples as others."""


def experiment(
    variant: str,
    rate_hz: float,
    cycles: float,
    frequencies_hz: tuple[float, ...],
    *,
    short: bool = True,
    seed: int = 1,
    **rig: Any,
) -> ExperimentConfig:
    """Return an experiment with a sine of each frequency, whose samples are later by some cycles.

    Without a filter, samples behind a held voltage have a delay of about half a cycle less than
    none.

    Args:
        variant: Name of the variant, of `SENSORS`.
        rate_hz: Rate of the loop, in Hz.
        cycles: Additional delay, in cycles.
        frequencies_hz: Frequencies of the sines, in Hz.
        short: Whether the identification is short.
        seed: Seed of the specimen.
        rig: Further options of the rig.
    """
    later_s = cycles / rate_hz
    config = experiment_of(variant, seed, sensor={"delay_s": 0.00011 + later_s}, **rig)
    axis = config.axes["x"]
    delay = {"sensor_delay_s": SENSORS[variant] + later_s}
    compensator = axis.compensator.model_copy(update=delay)
    return config.model_copy(
        update={
            "rate_hz": rate_hz,
            "axes": {"x": axis.model_copy(update={"compensator": compensator})},
            "identification": _identification(config, short),
            "settle_s": 1.0,
            "modes": (Mode.FEEDFORWARD, Mode.ADAPTIVE),
            "cases": tuple(_case(frequency_hz) for frequency_hz in frequencies_hz),
        }
    )


class Errors(NamedTuple):
    """True errors of an experiment."""

    delay_s: float  #: Delay that was identified, in s.
    worst_pct: dict[tuple[str, Mode], float]  #: Case and mode → worst error, in % of the range.


def errors_of(config: ExperimentConfig, identified_hz: float | None = None) -> Errors:
    """Return the errors of all cases.

    Each mode has a stage of its own, with the same specimen, model and past: on one stage, creep
    and zero of the second mode would be others.

    Args:
        config: The experiment.
        identified_hz: Rate of the loop in which the stage is identified, in Hz, if another one.
    """
    before = config.model_copy(update={"rate_hz": identified_hz or config.rate_hz})
    with opened(before, _tell_nobody) as stage:
        axis = identify_axes(stage, before)["x"]
    axis = replace(axis, model=in_loop(axis.config, axis.model, None, 1.0 / config.rate_hz))
    worst_pct = {}
    for mode in config.modes:
        for case, error_pct in _run(config, axis, mode).items():
            worst_pct[case, mode] = error_pct
    return Errors(axis.model.delay_s, worst_pct)


def _run(config: ExperimentConfig, axis: IdentifiedAxis, mode: Mode) -> dict[str, float]:
    with opened(config, _tell_nobody) as stage:
        stage.rest(config.settle_s)
        (trace,) = stage.open_loop([lambda t_s: 74.0 - 74.0 * np.cos(np.pi * t_s)], _SWEEPS_S)
        creeping = Creeping(axis.model, axis.config.limits.rest_v, 1.0 / config.rate_hz)
        creeping.watch(trace[:, POSITION_UM])
        creeping.follow(trace[:, IN_FORCE_V])
        axes = {"x": replace(axis, creeping=creeping)}
        runs = [run_case(stage, config, axes, case, mode)[0] for case in config.cases]
    return {run.recording.case: run.recording.metrics["true_tracking_max_pct"] for run in runs}


def _tell_nobody(_cycles: float) -> None:
    pass


def _identification(config: ExperimentConfig, short: bool) -> Any:
    identification = config.identification
    if not short:
        return identification
    assert identification is not None
    assert isinstance(identification.drive_v, Sequence)
    parts = tuple(
        part.model_copy(update={"duration_s": duration_s})
        for part, duration_s in zip(identification.drive_v.parts, _PARTS_S, strict=True)
    )
    return identification.model_copy(
        update={
            "run_in_s": _PARTS_S[0],
            "duration_s": sum(_PARTS_S),
            "drive_v": identification.drive_v.model_copy(update={"parts": parts}),
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
