"""The waveforms of an experiment, learned one after the other on an axis, virtual or running."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from piezod.config.play import PlayConfig
from piezod.experiment.play.axis import PlayingAxis
from piezod.experiment.play.command import command_of
from piezod.experiment.play.learn import LearnedPlay, PassReport, learn
from piezod.experiment.play.response import KnownResponse, MultisineSettings
from piezod.experiment.play.stored import Conditions, find_table
from piezod.experiment.play.task import PlaySettings
from piezod.experiment.prefix import prefix_errors
from piezod.experiment.progress import Meter, Progress

Keep = Callable[[int, LearnedPlay, Conditions], None]
"""Called with each learned waveform as soon as it is learned: its number from 1, and its table's
conditions. A later waveform may fail."""


def keep_nothing(_number: int, _learned: LearnedPlay, _conditions: Conditions) -> None:
    """Keep the result of the whole experiment only."""


@dataclass(frozen=True, eq=False)
class PlayedResult:
    """What was played on one axis."""

    axis: str  #: Name of the axis.
    response: KnownResponse  #: Its response.
    conditions: Conditions  #: Conditions of its tables.
    plays: tuple[LearnedPlay, ...]  #: The learned waveforms, in order.
    notes: tuple[str, ...]  #: Notes on stored tables, for people.


@dataclass(frozen=True, eq=False)
class PlayedExperiment:
    """What was played in an experiment."""

    title: str  #: Description, for people.
    seed: int  #: Seed of the random values in simulated devices.
    axes: tuple[PlayedResult, ...]  #: Each axis, in order.
    warnings: tuple[str, ...] = ()  #: Warnings, a sentence each.


def play_meter(progress: Progress, play: PlayConfig, n_axes: int) -> Meter:
    """Return a meter that counts the plays of an experiment on this number of axes."""
    return Meter(progress, n_axes * (1 + len(play.waves) * (play.passes + 2)))


def learn_waves(
    axis: PlayingAxis,
    play: PlayConfig,
    meter: Meter,
    tables: Path | None,
    keep: Keep = keep_nothing,
) -> PlayedResult:
    """Measure the response of an axis, then learn every waveform.

    If there is a folder `tables`, each begins with a table whose conditions agree. `keep` is called
    with each one that is learned.

    Raises:
        PiezodError: If the response could not be measured, or nothing of a waveform was learned.
    """
    name = axis.conditions.axis
    meter.begin(f"axis {name}, response")
    amplitude = play.amplitude_pct / 100.0
    multisine = MultisineSettings(axis.interval_ns, play.lowest_hz, play.highest_hz, amplitude)
    with prefix_errors("response"):
        known = axis.known(multisine)
    meter.advance(1.0)
    settings = PlaySettings(play.passes, play.settle_s, play.record_s)
    plays, notes = [], []
    for number, wave in enumerate(play.waves, start=1):
        command, first_um = command_of(wave, axis.interval_ns), None
        if tables is not None:
            first_um, note = find_table(tables, axis.conditions, command)
            notes.append(f"Axis {name}, {wave.name}: {note}.")
        label = f"axis {name}, {wave.name}"
        task = known.task(command, settings, first_um)
        with prefix_errors(wave.name):
            # Without a learned table, the inverse model alone shows what the response adds.
            plays.append(
                learn(axis.stage, task, partial(_count, meter, label), compare=first_um is None)
            )
        keep(number, plays[-1], axis.conditions)
    return PlayedResult(name, known.response, axis.conditions, tuple(plays), tuple(notes))


def _count(meter: Meter, label: str, report: PassReport) -> None:
    """Count a play of a waveform that has ended."""
    meter.label = f"{label}: {report.label}"
    meter.advance(1.0)
