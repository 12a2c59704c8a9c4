"""An experiment with `play` on a running stage: its waveforms are learned there."""

from pathlib import Path

from piezod.client import StageClient
from piezod.config.experiment import ExperimentConfig
from piezod.config.play import PlayConfig
from piezod.experiment.live.plan import check_live, not_used
from piezod.experiment.live.running_axis import playing_axis
from piezod.experiment.live.setup import read_setup
from piezod.experiment.live.stage import LiveStage
from piezod.experiment.play.waves import (
    Keep,
    PlayedExperiment,
    keep_nothing,
    learn_waves,
    play_meter,
)
from piezod.experiment.progress import Progress


def run_plays_live(
    config: ExperimentConfig,
    play: PlayConfig,
    client: StageClient,
    progress: Progress,
    tables: Path | None = None,
    keep: Keep = keep_nothing,
) -> PlayedExperiment:
    """Learn every waveform on every axis of a running stage, and disarm it at the end.

    The file's devices, models and responses are not used. `tables` and `keep` are as in
    `learn_waves`.

    Raises:
        ClientError: If a request is refused, or the stage leaves the expected states.
        ConfigError: If a table file is not valid.
        DataError: If the experiment does not fit the stage, before anything moves; or if a record
            cannot be used, or a command leaves its range.
        ModelError: If a model in use is not valid.
    """
    setup = read_setup(client)
    check_live(config, setup)
    meter = play_meter(progress, play, len(config.axes))
    with LiveStage(client, setup, lambda _over_s: None) as stage:
        meter.begin("resting")
        stage.arm_at_rest(config.settle_s)
        axes = tuple(
            learn_waves(
                playing_axis(stage, setup, name, play.interval_ns, config.settle_s),
                play,
                meter,
                tables,
                keep,
            )
            for name in config.axes
        )
        stage.disarm()
    title = f"{config.title} (live on stage {setup.stage})".strip()
    return PlayedExperiment(title, setup.seed, axes, (*not_used(config, setup), *stage.notes))
