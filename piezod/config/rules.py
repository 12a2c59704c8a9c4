"""The rules of an experiment that concern more than one of its parts."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING

from piezod.config.commands import CommandPerAxis
from piezod.config.document import KeyPath
from piezod.config.fields import BrokenRule
from piezod.config.messages import show, suggest

if TYPE_CHECKING:
    from piezod.config.combined_waveforms import WaveformConfig
    from piezod.config.experiment import CaseConfig, ExperimentConfig


def broken_rules(experiment: "ExperimentConfig") -> Iterator[BrokenRule]:
    """Find everything in an experiment that does not fit together."""
    names = [case.name for case in experiment.cases]
    return chain(
        _devices(experiment),
        _identification(experiment),
        _duplicates(("modes",), experiment.modes),
        _duplicates(("metrics",), experiment.metrics),
        (((*path, "name"), what) for path, what in _duplicates(("cases",), names)),
        *(
            _commands(experiment, ("cases", index, "command_um"), case)
            for index, case in enumerate(experiment.cases)
        ),
    )


def _devices(experiment: "ExperimentConfig") -> Iterator[BrokenRule]:
    known = list(experiment.devices)
    for name, axis in experiment.axes.items():
        for role, device in (("amplifier", axis.amplifier), ("sensor", axis.sensor)):
            if device not in known:
                what = f"no such device (got {show(device)}), {suggest(device, known, 'known')}"
                yield ("axes", name, role), what


def _identification(experiment: "ExperimentConfig") -> Iterator[BrokenRule]:
    without_model = [name for name, axis in experiment.axes.items() if axis.model is None]
    if experiment.identification is None:
        for name in without_model:
            yield ("axes", name), "needs a model file, or `identification:` to make the model"
        return
    if not without_model:
        yield ("identification",), "not used, every axis starts from a model file"
    for name in without_model:
        limits = experiment.axes[name].limits
        allowed = limits.drive_min_v, limits.drive_max_v
        drive = experiment.identification.drive_v
        yield from _outside(("identification", "drive_v"), drive, name, allowed, "V")


def _commands(
    experiment: "ExperimentConfig", path: KeyPath, case: "CaseConfig"
) -> Iterator[BrokenRule]:
    commands = case.commands(experiment.axes)
    for name in commands.keys() - experiment.axes.keys():
        known = list(experiment.axes)
        yield (*path, "axes", name), f"no such axis, {suggest(name, known, 'known')}"
    for name, axis in experiment.axes.items():
        if name not in commands:
            yield (*path, "axes"), f"no command for axis {name}"
        elif axis.command_range_um is not None:
            place = (*path, "axes", name) if isinstance(case.command_um, CommandPerAxis) else path
            yield from _outside(place, commands[name], name, axis.command_range_um, "µm")


def _outside(
    path: KeyPath, waveform: "WaveformConfig", axis: str, allowed: tuple[float, float], unit: str
) -> Iterator[BrokenRule]:
    low, high = waveform.bounds()
    # Bounds are sums of what the file says: they may be off by rounding.
    margin = 1e-9 * (allowed[1] - allowed[0])
    if low < allowed[0] - margin or high > allowed[1] + margin:
        yield (
            path,
            f"may go beyond what axis {axis} allows (got {low:g} to {high:g} {unit}), "
            f"allowed range {allowed[0]:g} to {allowed[1]:g} {unit}",
        )


def _duplicates(path: KeyPath, words: Sequence[str]) -> Iterator[BrokenRule]:
    for index, word in enumerate(words):
        if word in words[:index]:
            yield (*path, index), f"stands there twice (got {show(word)})"
