"""Rules of an experiment that concern several of its parts."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Final

from piezod.config.axes import STOPS_DELAY_S, CompensatorConfig
from piezod.config.channel_rules import broken_devices
from piezod.config.commands import CommandPerAxis
from piezod.config.document import KeyPath
from piezod.config.experiment_fields import (
    CaseConfig,
    ExperimentFields,
    IdentificationConfig,
    Method,
)
from piezod.config.fields import BrokenRule, Drivers
from piezod.config.frequencies import too_fast
from piezod.config.messages import show, suggest
from piezod.config.model_file import SURFACE_COEFFICIENTS
from piezod.config.scan import broken_scan
from piezod.config.waveforms.combined import WaveformConfig

MIN_JUDGED_SAMPLES: Final = 10
"""Smallest number of samples for the errors of a run."""
SAMPLES_PER_WEIGHT: Final = 5
"""Smallest number of samples per weight; with fewer, a fit follows the noise."""
_ONLY_STOPS: Final = {
    "operators": "operators",
    "thresholds": "thresholds",
    "deadband_pct": "dead-band",
}
"""Keys of the compensator that a surface does not use, and their names in messages."""
_OF_SURFACE: Final = ("creep", "identifier", "learned_pct", "delay_s", "sensor_delay_s")


def broken_rules(experiment: ExperimentFields, drivers: Drivers | None) -> Iterator[BrokenRule]:
    """Yield all contradictions between the parts of an experiment.

    Args:
        experiment: The experiment.
        drivers: Drivers, which list the channels of their devices; None if they are not available.
    """
    names = [case.name for case in experiment.cases]
    return chain(
        broken_devices(experiment.devices, experiment.axes, drivers),
        _without_sensor(experiment),
        _play(experiment),
        _identification(experiment),
        _duplicates(("modes",), experiment.modes),
        _duplicates(("metrics",), experiment.metrics),
        (((*path, "name"), what) for path, what in _duplicates(("cases",), names)),
        *(
            _commands(experiment, ("cases", index, "command_um"), case)
            for index, case in enumerate(experiment.cases)
        ),
        *(
            _long_enough(("cases", index, "duration_s"), case, experiment.rate_hz)
            for index, case in enumerate(experiment.cases)
        ),
    )


def _play(experiment: ExperimentFields) -> Iterator[BrokenRule]:
    kinds = bool(experiment.cases), experiment.play is not None, experiment.scan is not None
    if sum(kinds) != 1:
        what = "an experiment has at least one case, or `play` with waveforms, or a `scan`"
        yield ("cases",), f"{what}: one of them"
    if experiment.scan is not None:
        ranges = {name: axis.command_range_um for name, axis in experiment.axes.items()}
        for place, what in broken_scan(experiment.scan, ranges):
            yield ("scan", *place), what
    if experiment.play is None:
        return
    for name, axis in experiment.axes.items():
        if axis.command_range_um is None:
            continue
        for index, wave in enumerate(experiment.play.waves):
            path: KeyPath = ("play", "waves", index, "command_um")
            yield from _outside(path, wave.command_um, name, axis.command_range_um, "µm")


def _without_sensor(experiment: ExperimentFields) -> Iterator[BrokenRule]:
    for name, axis in experiment.axes.items():
        if axis.sensor is None:
            yield (
                ("axes", name, "sensor"),
                "needs a `sensor`: an experiment measures the errors of each axis",
            )


def _identification(experiment: ExperimentFields) -> Iterator[BrokenRule]:
    without_model = [name for name, axis in experiment.axes.items() if axis.model is None]
    if experiment.identification is None:
        for name in without_model:
            yield ("axes", name), "needs a model file, or `identification:` to make the model"
        return
    if not without_model:
        yield ("identification",), "not used, every axis starts from a model file"
    for name in without_model:
        path = ("axes", name, "compensator")
        settings = experiment.axes[name].compensator
        yield from _unfit(path, settings, experiment.identification.method)
        limits = experiment.axes[name].limits
        allowed = limits.drive_min_v, limits.drive_max_v
        drive = experiment.identification.drive_v
        yield from _too_fast(("identification", "drive_v"), drive, experiment.rate_hz)
        yield from _outside(("identification", "drive_v"), drive, name, allowed, "V")
    if without_model:
        yield from _too_short(experiment, experiment.identification, without_model)


def _unfit(path: KeyPath, settings: CompensatorConfig, method: Method) -> Iterator[BrokenRule]:
    """Check the compensator of an axis for the method of its identification."""
    if settings.creep and method == "lms":
        what = "lms cannot identify creep, leave it out or use method least-squares"
        yield (*path, "creep"), what
    if settings.has_negative_delay and method != "surface":
        what = f"out of range for the operators of {method} (got {settings.delay_s} s)"
        yield (*path, "delay_s"), f"{what}, {STOPS_DELAY_S}; method surface takes a negative delay"
    if method != "surface":
        return
    for key, own in _ONLY_STOPS.items():
        if key in settings.model_fields_set:
            what = f"not used, a surface has no {own}, leave it out or use method least-squares"
            yield (*path, key), f"{what} (method surface uses {', '.join(_OF_SURFACE)})"
    if settings.identifier != "rls":
        what = f"identifier {settings.identifier} learns the weights of stop operators"
        yield path, f"{what}, use identifier rls without lms_gain, or method least-squares"


def _too_short(
    experiment: ExperimentFields, identification: IdentificationConfig, names: list[str]
) -> Iterator[BrokenRule]:
    """Check the length of the identification for the axis with the most operators."""
    largest = max(names, key=lambda name: experiment.axes[name].compensator.operators)
    n_weights = 2 * experiment.axes[largest].compensator.operators
    if identification.method == "surface":
        n_weights = SURFACE_COEFFICIENTS
    run_in_s = identification.run_in_s
    shortest_s = run_in_s + SAMPLES_PER_WEIGHT * n_weights / experiment.rate_hz
    if identification.duration_s < shortest_s:
        after = f" after run_in_s, {run_in_s:g} s," if run_in_s else ""
        yield (
            ("identification", "duration_s"),
            f"too short{after} for the {n_weights} weights of axis {largest} at "
            f"{experiment.rate_hz:g} Hz (got {identification.duration_s:g} s), "
            f"allowed: at least {shortest_s:g} s",
        )


def _long_enough(path: KeyPath, case: CaseConfig, rate_hz: float) -> Iterator[BrokenRule]:
    """Check that enough samples of a case remain for the metrics."""
    shortest_s = case.period_s + MIN_JUDGED_SAMPLES / rate_hz
    # The sum of two numbers of the file may be off by rounding.
    if case.duration_s < shortest_s * (1 - 1e-9):
        yield (
            path,
            f"leaves fewer than {MIN_JUDGED_SAMPLES} samples after period_s at {rate_hz:g} Hz "
            f"(got {case.duration_s:g} s), allowed: at least {shortest_s:g} s",
        )


def _commands(
    experiment: ExperimentFields, path: KeyPath, case: CaseConfig
) -> Iterator[BrokenRule]:
    commands = case.commands(experiment.axes)
    for name in commands.keys() - experiment.axes.keys():
        known = list(experiment.axes)
        yield (*path, "axes", name), f"no such axis, {suggest(name, known, 'known')}"
    for name, axis in experiment.axes.items():
        if name not in commands:
            yield (*path, "axes"), f"no command for axis {name}"
            continue
        # A command for all axes has no `axes` in the file.
        place = (*path, "axes", name) if isinstance(case.command_um, CommandPerAxis) else path
        yield from _too_fast(place, commands[name], experiment.rate_hz)
        if axis.command_range_um is not None:
            yield from _outside(place, commands[name], name, axis.command_range_um, "µm")


def _too_fast(path: KeyPath, waveform: WaveformConfig, rate_hz: float) -> Iterator[BrokenRule]:
    if why := too_fast(waveform.highest_hz(), rate_hz):
        yield path, why


def _outside(
    path: KeyPath, waveform: WaveformConfig, axis: str, allowed: tuple[float, float], unit: str
) -> Iterator[BrokenRule]:
    low, high = waveform.bounds()
    # Bounds are sums of numbers of the file: they may be off by rounding.
    margin = 1e-9 * (allowed[1] - allowed[0])
    if low < allowed[0] - margin or high > allowed[1] + margin:
        yield (
            path,
            f"may exceed the range of axis {axis} (got {low:g} to {high:g} {unit}), "
            f"allowed range {allowed[0]:g} to {allowed[1]:g} {unit}",
        )


def _duplicates(path: KeyPath, words: Sequence[str]) -> Iterator[BrokenRule]:
    for index, word in enumerate(words):
        if word in words[:index]:
            yield (*path, index), f"appears twice (got {show(word)})"
