"""The runs from which the figures and tables of the documentation are made."""

from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Final

from docs.figures.errors import (
    ErrorsByCase,
    ErrorsOfModes,
    true_errors_by_case,
    worst_of_cases,
)
from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.config.experiment_fields import CaseConfig
from piezod.config.modes import Mode
from piezod.devices import registry
from piezod.experiment.reference import reference_of
from piezod.experiment.virtual.case import run_case
from piezod.experiment.virtual.creeping import Creeping
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.run import run_experiment
from piezod.experiment.virtual.stage import opened
from piezod.plant.variants import VARIANTS
from piezod.records.experiment_result import ExperimentResult, Recording
from piezod.records.reference import Reference
from piezod.units import NS_PER_S
from tests.experiment.beyond import experiment_of, with_stops, without_response

EXPERIMENTS: Final = Path(__file__).parents[2] / "config" / "experiments"
COMPENSATED: Final = (Mode.FEEDFORWARD, Mode.ADAPTIVE, Mode.TRIMMED)

MOVE_S, HOLD_S = 1.0, 100.0
WITHOUT_CREEP: Final = "feedforward, creep left out of the model"
_OTHER_SPECIMEN: Final = 5
"""Seed of a stack with 11 % less travel than the first, and other loops."""


def errors_of_variants() -> Iterator[tuple[str, ErrorsOfModes, ErrorsOfModes]]:
    """Run every variant with both classes of models, in as many processes as there are processors.

    Yields:
        Name of the variant, its errors in the compensated modes with a surface, and in feedforward
        with stops.
    """
    surfaces = [_in_modes(experiment_of(each), COMPENSATED) for each in VARIANTS]
    stops = [_in_modes(with_stops(experiment_of(each)), COMPENSATED[:1]) for each in VARIANTS]
    with ProcessPoolExecutor() as pool:
        errors = pool.map(_errors_of, chain.from_iterable(zip(surfaces, stops, strict=True)))
        for variant in VARIANTS:
            yield variant, next(errors), next(errors)


def _in_modes(config: ExperimentConfig, modes: tuple[Mode, ...]) -> ExperimentConfig:
    return config.model_copy(update={"modes": modes})


def _errors_of(config: ExperimentConfig) -> ErrorsOfModes:
    return worst_of_cases(run(config).recordings)


def of_the_paper() -> tuple[ExperimentResult, Reference]:
    """Run the experiment of the paper; return it with the errors of the paper."""
    config = load_experiment(EXPERIMENTS / "qiu.yaml", registry)
    reference = reference_of(config)
    if reference is None:
        raise SystemExit("qiu.yaml lacks reference_pct, the errors of the paper")
    return run(config), reference


def run(config: ExperimentConfig) -> ExperimentResult:
    """Run an experiment."""
    return run_experiment(config, "", config.title, lambda _label, _share: None)


def fast_motion() -> tuple[ErrorsByCase, ErrorsByCase]:
    """Run the experiment on fast motion without the response of its stage, and with it."""
    known = load_experiment(EXPERIMENTS / "dynamics.yaml", registry)
    with ProcessPoolExecutor() as pool:
        without, with_it = pool.map(_true_errors_of, (without_response(known), known))
    return without, with_it


def _true_errors_of(config: ExperimentConfig) -> ErrorsByCase:
    return true_errors_by_case(run(config).recordings)


def holds() -> Mapping[str, Recording]:
    """Move the stack and hold it: without a model of its creep, with one, and trimmed."""
    config = experiment_of("stack").model_copy(
        update={"cases": (_hold_case(),), "modes": (Mode.FEEDFORWARD, Mode.TRIMMED)}
    )
    axis = config.axes["x"]
    plain = axis.compensator.model_copy(update={"creep": False})
    without = config.model_copy(
        update={
            "axes": {"x": axis.model_copy(update={"compensator": plain})},
            "modes": (Mode.FEEDFORWARD,),
        }
    )
    feedforward, trimmed = run(config).recordings
    (creeping,) = run(without).recordings
    return {
        WITHOUT_CREEP: creeping,
        "feedforward": feedforward,
        "trimmed": trimmed,
    }


def on_another_specimen() -> tuple[Recording, ...]:
    """Identify one stack, then run a case on another one with the model of the first."""
    config = experiment_of("stack")
    with opened(config, _ignore) as stage:
        first = identify_axes(stage, config)["x"]
    # It has 13 % more travel: more than what a learned model may differ by default.
    wide = first.config.compensator.model_copy(update={"learned_pct": 20.0})
    axis = first.config.model_copy(update={"compensator": wide})
    other = config.model_copy(update={"seed": _OTHER_SPECIMEN})
    recordings: list[Recording] = []
    for mode in COMPENSATED:
        with opened(other, _ignore) as stage:
            rest_v = axis.limits.rest_v
            creeping = Creeping(first.model, rest_v, stage.period_ns / NS_PER_S)
            axes = {"x": replace(first, config=axis, creeping=creeping)}
            runs = run_case(stage, other, axes, config.cases[1], mode)
            recordings += [each.recording for each in runs]
    return tuple(recordings)


def _ignore(_further_s: float) -> None:
    pass


def _hold_case() -> CaseConfig:
    rise = {"kind": "triangle", "low": 0, "high": 20, "frequency_hz": 0.5 / MOVE_S}
    return CaseConfig.model_validate(
        {
            "name": "hold",
            "period_s": MOVE_S,
            "duration_s": MOVE_S + HOLD_S,
            "command_um": {
                "kind": "sequence",
                "parts": (
                    {"duration_s": MOVE_S, "waveform": rise},
                    {"duration_s": HOLD_S, "waveform": {"kind": "setpoint", "level": 20}},
                ),
            },
        }
    )
