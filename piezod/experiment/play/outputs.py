"""Output of a played waveform in a folder: its figure, and its learned table."""

from datetime import datetime
from pathlib import Path

from piezod.config.play import WaveConfig
from piezod.experiment.play.learn import INVERSE, LearnedPlay
from piezod.experiment.play.stored import Conditions, to_table_file, write_table
from piezod.records.figures.play import PlayedErrors, play_figure
from piezod.records.figures.style import save_png
from piezod.units import NS_PER_S


def write_play(
    folder: Path,
    number: int,
    play: LearnedPlay,
    wave: WaveConfig,
    conditions: Conditions,
    created_at: datetime,
) -> Path:
    """Write the figure and the table file of a waveform; return the path of the figure.

    Raises:
        OSError: If a file cannot be written.
    """
    name = f"{conditions.axis}_{number:02d}"
    table = to_table_file(play, conditions, created_at)
    write_table(folder / f"table_{name}.yaml", table)
    plays = [
        PlayedErrors(
            each.label,
            each.true_error_um if each.knows_truth else each.error_um,
            each.measured[:2],
            each.true[:2],
        )
        for each in play.reports
    ]
    first = 1 if play.reports[0].label == INVERSE else 0
    published = {f"{wave.reference}, {kind}": pct for kind, pct in wave.reference_pct.items()}
    figure = play_figure(
        f"{wave.name} · axis {conditions.axis}: {play.stopped}",
        play.command.interval_ns / NS_PER_S,
        play.command.values_um,
        plays,
        (first, play.reports.index(play.best)),
        published,
    )
    path = folder / f"play_{name}.png"
    save_png(path, figure)
    return path
