"""`piezod experiment` with `play`: runs it, and writes the outputs."""

from contextlib import AbstractContextManager
from datetime import datetime
from pathlib import Path

from piezod.cli.experiment.plays_view import play_document, print_play
from piezod.cli.interrupt import unwinding
from piezod.cli.output import new_console, print_json
from piezod.cli.progress import progress_bar
from piezod.client import StageClient
from piezod.config.experiment import ExperimentConfig
from piezod.config.play import PlayConfig
from piezod.experiment.live.run_plays import run_plays_live
from piezod.experiment.play.learn import LearnedPlay
from piezod.experiment.play.outputs import write_play
from piezod.experiment.play.stored import Conditions
from piezod.experiment.virtual.play import run_plays


def run_play(
    config: ExperimentConfig,
    play: PlayConfig,
    folder: Path,
    tables: Path | None,
    connection: AbstractContextManager[StageClient] | None,
    *,
    json: bool,
) -> None:
    """Run an experiment with `play`, write its outputs, and print the result.

    Args:
        config: The experiment.
        play: Its waveforms.
        folder: Output folder, present.
        tables: Folder of tables to begin with; None for none.
        connection: Opens a connection to the stage that plays; None for virtual time.
        json: Whether one JSON document is printed.
    """
    figures: list[Path] = []

    def keep(number: int, learned: LearnedPlay, conditions: Conditions) -> None:
        wave, now = play.waves[number - 1], datetime.now().astimezone()
        figures.append(write_play(folder, number, learned, wave, conditions, now))

    with progress_bar() as progress:
        if connection is None:
            played = run_plays(config, play, progress, tables, keep)
        else:
            with unwinding(), connection as client:
                played = run_plays_live(config, play, client, progress, tables, keep)
    if json:
        print_json(play_document(played, play, figures))
    else:
        print_play(new_console(), played, play, folder)
