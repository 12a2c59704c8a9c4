"""Checks whether an experiment fits a running stage, and which parts of its file are not used."""

import json
from collections.abc import Iterator
from typing import Final

from piezod.client import calls
from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import CaseConfig
from piezod.config.frequencies import too_fast
from piezod.config.modes import Mode
from piezod.config.play import PlayConfig
from piezod.config.rules import MIN_JUDGED_SAMPLES
from piezod.config.waveforms.combined import pack_waveforms
from piezod.config.waveforms.waveform import WaveformCostError
from piezod.errors import DataError, RefusedError
from piezod.experiment.error_rows import NEED_TRUTH
from piezod.experiment.live.setup import LiveAxis, LiveSetup, no_model
from piezod.experiment.play.command import command_of
from piezod.experiment.session.runs import RANGE_MARGIN
from piezod.messages.requests import TABLE

LARGEST_REQUEST_BYTES: Final = TABLE["wave"].access.most_bytes
"""Largest request that a daemon accepts, in bytes."""


def check_live(config: ExperimentConfig, setup: LiveSetup) -> None:
    """Refuse an experiment that does not fit a stage, before anything moves.

    Raises:
        DataError: If something does not fit; the text has a line for each problem.
    """
    problems = list(_problems(config, setup))
    if problems:
        raise DataError("\n".join(f"stage {setup.stage}: {problem}" for problem in problems))


def not_used(config: ExperimentConfig, setup: LiveSetup) -> Iterator[str]:
    """Yield the parts of a file that are not used on a running stage, a sentence each."""
    yield (
        f"Run on stage {setup.stage} with its own configuration: the file's devices, seed, "
        "identification and axes, except their names, were not used."
    )
    if config.rate_hz != setup.rate_hz:
        yield (
            f"rate_hz of the file, {config.rate_hz:g} Hz, was not used: "
            f"stage {setup.stage} runs at {setup.rate_hz:g} Hz."
        )
    others = ", ".join(name for name in setup.axes if name not in config.axes)
    if others:
        yield f"Axes of stage {setup.stage} that are not in the file, and that rested: {others}."


def _problems(config: ExperimentConfig, setup: LiveSetup) -> Iterator[str]:
    needing = ", ".join(name for name in config.metrics if name in NEED_TRUTH)
    if needing:
        yield (
            f"metrics requests {needing}, but the true displacement of a running stage is "
            "unknown; remove these"
        )
    compensated = [f"mode {mode}" for mode in config.modes if mode is not Mode.UNCOMPENSATED]
    needing_model = ["a table"] if config.play is not None else compensated
    for name in config.axes:
        if name not in setup.axes:
            yield f"no axis {name}; its axes are {', '.join(setup.axes)}"
        elif setup.axes[name].config.sensor is None:
            yield f"axis {name} has no sensor, and an experiment measures its errors: configure one"
        elif setup.axes[name].model is None and needing_model:
            yield no_model(name, needing_model[0])
    for case in config.cases:
        yield from _problems_of(case, config, setup)
    if config.play is not None:
        yield from _problems_of_play(config.play, config, setup)


def _problems_of(case: CaseConfig, config: ExperimentConfig, setup: LiveSetup) -> Iterator[str]:
    judged = (case.duration_s - case.period_s) * setup.rate_hz
    if judged < MIN_JUDGED_SAMPLES:
        yield (
            f"{case.name} leaves {judged:.1f} samples after period_s at {setup.rate_hz:g} Hz, "
            f"allowed: at least {MIN_JUDGED_SAMPLES}; make it longer"
        )
    yield from _too_large(case, config)
    for name, command in case.commands(config.axes).items():
        if name in setup.axes:
            if why := too_fast(command.highest_hz(), setup.rate_hz):
                yield f"{case.name}, axis {name}: {why}"
            waveform = command.built(case.duration_s)
            yield from out_of_range(case.name, name, setup.axes[name], waveform.low, waveform.high)


def _problems_of_play(
    play: PlayConfig, config: ExperimentConfig, setup: LiveSetup
) -> Iterator[str]:
    for wave in play.waves:
        try:
            command_of(wave, play.interval_ns)
        except DataError as error:
            yield str(error)
        for name in config.axes:
            if name in setup.axes:
                low_high_um = wave.command_um.bounds()
                yield from out_of_range(wave.name, name, setup.axes[name], *low_high_um)


def _too_large(case: CaseConfig, config: ExperimentConfig) -> Iterator[str]:
    """Yield a problem if the points of a waveform are too many for a request."""
    try:
        commands_um = case.commands(config.axes)
        body = calls.command("wave", command_um=commands_um, duration_s=case.duration_s).body
        pack_waveforms(commands_um, case.duration_s)
    except (RefusedError, WaveformCostError) as error:
        yield f"{case.name} cannot be sent: {error}"
        return
    size = len(json.dumps(body, separators=(",", ":")))
    if size > LARGEST_REQUEST_BYTES:
        yield (
            f"{case.name} has waveforms of {size} bytes, allowed: at most {LARGEST_REQUEST_BYTES}; "
            "use fewer points, or fewer digits"
        )


def out_of_range(
    case: str, name: str, axis: LiveAxis, low_um: float, high_um: float
) -> Iterator[str]:
    """Yield the problem of a command that leaves what an axis may be commanded, or its model."""
    allowed = [("may be commanded", axis.range_um, 1e-9)]
    if axis.model is not None:
        low_high_um = axis.model.position_um.low, axis.model.position_um.high
        allowed.append(("was identified", low_high_um, RANGE_MARGIN))
    for relation, (lowest_um, highest_um), share in allowed:
        margin_um = share * (highest_um - lowest_um)
        if low_um < lowest_um - margin_um or high_um > highest_um + margin_um:
            yield (
                f"{case} commands {low_um:g} to {high_um:g} µm, but axis {name} {relation} from "
                f"{lowest_um:.4g} to {highest_um:.4g} µm"
            )
