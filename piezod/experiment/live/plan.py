"""Whether an experiment can be run on a running stage, and what of its file is not used there."""

import json
from collections.abc import Iterator
from typing import Final

from piezod.client import calls
from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import CaseConfig
from piezod.config.modes import Mode
from piezod.config.requests import TABLE
from piezod.config.rules import MIN_JUDGED_SAMPLES
from piezod.control.reference.waveforms import build_waveform
from piezod.errors import DataError, RefusedError
from piezod.experiment.error_rows import NEED_TRUTH
from piezod.experiment.live.setup import LiveAxis, LiveSetup
from piezod.experiment.virtual.case import BEYOND

LARGEST_REQUEST_BYTES: Final = TABLE["wave"].access.most_bytes
"""What a daemon takes at once."""


def check_live(config: ExperimentConfig, setup: LiveSetup) -> None:
    """Refuse an experiment that a stage cannot run, before anything moves.

    Raises:
        DataError: If there is something that does not fit; the text has a line for each.
    """
    problems = list(_problems(config, setup))
    if problems:
        raise DataError("\n".join(f"stage {setup.stage}: {problem}" for problem in problems))


def not_used(config: ExperimentConfig, setup: LiveSetup) -> Iterator[str]:
    """Yield what of a file has no meaning on a running stage, a sentence each."""
    yield (
        f"Run on stage {setup.stage} as it is configured: of the file's devices, seed, "
        "identification, and axes but for their names, nothing was used."
    )
    if config.rate_hz != setup.rate_hz:
        yield (
            f"rate_hz of the file, {config.rate_hz:g} Hz, was not used: "
            f"stage {setup.stage} runs at {setup.rate_hz:g} Hz."
        )
    others = ", ".join(name for name in setup.axes if name not in config.axes)
    if others:
        yield f"Axes of stage {setup.stage} that the file does not have, and that rested: {others}."


def _problems(config: ExperimentConfig, setup: LiveSetup) -> Iterator[str]:
    needing = ", ".join(name for name in config.metrics if name in NEED_TRUTH)
    if needing:
        yield (
            f"metrics asks for {needing}, but the true displacement of a running stage is not "
            "known; leave these out"
        )
    compensated = [mode for mode in config.modes if mode is not Mode.UNCOMPENSATED]
    for name in config.axes:
        if name not in setup.axes:
            yield f"no axis {name}; its axes are {', '.join(setup.axes)}"
        elif setup.axes[name].model is None and compensated:
            yield (
                f"axis {name} has no model, which mode {compensated[0]} needs; "
                "`piezod identify --live --adopt` makes one"
            )
    for case in config.cases:
        yield from _problems_of(case, config, setup)


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
            waveform = build_waveform(command, case.duration_s)
            yield from _beyond(case.name, name, setup.axes[name], waveform.low, waveform.high)


def _too_large(case: CaseConfig, config: ExperimentConfig) -> Iterator[str]:
    """Tell whether the points of a file are too many to be sent."""
    try:
        commands_um = case.commands(config.axes)
        body = calls.command("wave", command_um=commands_um, duration_s=case.duration_s).body
    except RefusedError as error:
        yield f"{case.name} cannot be sent: {error}"
        return
    size = len(json.dumps(body, separators=(",", ":")))
    if size > LARGEST_REQUEST_BYTES:
        yield (
            f"{case.name} has waveforms of {size} bytes, allowed: at most {LARGEST_REQUEST_BYTES}; "
            "use fewer points, or fewer digits"
        )


def _beyond(case: str, name: str, axis: LiveAxis, low_um: float, high_um: float) -> Iterator[str]:
    allowed = [("may be commanded", axis.range_um, 1e-9)]
    if axis.model is not None:
        low_high_um = axis.model.position_um.low, axis.model.position_um.high
        allowed.append(("was identified", low_high_um, BEYOND))
    for what, (lowest_um, highest_um), share in allowed:
        margin_um = share * (highest_um - lowest_um)
        if low_um < lowest_um - margin_um or high_um > highest_um + margin_um:
            yield (
                f"{case} commands {low_um:g} to {high_um:g} µm, but axis {name} {what} from "
                f"{lowest_um:.4g} to {highest_um:.4g} µm"
            )
