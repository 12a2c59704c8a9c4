"""Waveforms played from a table, in virtual time: identify, measure the response, learn."""

from pathlib import Path

from piezod.config.experiment import ExperimentConfig
from piezod.config.play import PlayConfig
from piezod.control.law.compensated import limits_of
from piezod.control.law.model import StageModel
from piezod.control.table_guard import TableGuard
from piezod.experiment.play.axis import PlayingAxis
from piezod.experiment.play.command import legal_interval_ns
from piezod.experiment.play.stage import AtRest, AxisPlayRecord, AxisTable, Identity
from piezod.experiment.play.waves import (
    Keep,
    PlayedExperiment,
    keep_nothing,
    learn_waves,
    play_meter,
)
from piezod.experiment.progress import Progress
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.stage import VirtualStage, opened
from piezod.units import NS_PER_S


class VirtualAxis:
    """Implements `IdentifiedStage` for one axis of a virtual stage."""

    def __init__(
        self, stage: VirtualStage, name: str, guard: TableGuard, rest_v: float, rest_s: float
    ) -> None:
        self._stage, self._name, self._guard = stage, name, guard
        self._rest_v, self._rest_s = rest_v, rest_s

    @property
    def identity(self) -> Identity:
        """Identity of the device."""
        return self._stage.identity(self._name)

    def rest(self) -> AtRest:
        """Go to rest, at the rest voltage.

        The read-back voltage has noise, which may be beyond a limit.
        """
        self._stage.go_to_rest(self._rest_s)
        return AtRest(self._stage.now_ns / NS_PER_S, self._rest_v)

    def play(self, table: AxisTable) -> AxisPlayRecord:
        """Play a table that the guard has checked; return its record."""
        return self._stage.play(self._name, table, self._guard)


def run_plays(
    config: ExperimentConfig,
    play: PlayConfig,
    progress: Progress,
    tables: Path | None = None,
    keep: Keep = keep_nothing,
) -> PlayedExperiment:
    """Learn every waveform on every axis, one axis after the other, in virtual time.

    `tables` and `keep` are as in `learn_waves`.

    Raises:
        ConfigError: If a model file or a table file cannot be used.
        DataError: If a record cannot be used, or a command leaves its range.
        DeviceError: If a device cannot be opened, does not play, or refuses a table.
        ModelError: If a gain is not safe.
    """
    meter = play_meter(progress, play, len(config.axes))
    with opened(config, lambda _: None) as stage:
        meter.begin("identification")
        identified = identify_axes(stage, config)
        stage.rest(config.settle_s)
        axes = tuple(
            learn_waves(_axis(stage, config, play, name, one.model), play, meter, tables, keep)
            for name, one in identified.items()
        )
    return PlayedExperiment(config.title, config.seed, axes)


def _axis(
    stage: VirtualStage, config: ExperimentConfig, play: PlayConfig, name: str, model: StageModel
) -> PlayingAxis:
    axis, able = config.axes[name], stage.played(name).capabilities
    rest_v = axis.limits.rest_v
    guard = TableGuard(limits_of(axis), rest_v, able.at_end, able.cycles)
    interval_ns = legal_interval_ns(able, play.interval_us)
    resting = VirtualAxis(stage, name, guard, rest_v, config.settle_s)
    return PlayingAxis.at_rest(resting, name, axis, model, interval_ns)
