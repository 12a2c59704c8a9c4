"""Waveforms played from a table, in virtual time: identify, measure the response, learn."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from piezod.config.experiment import ExperimentConfig
from piezod.config.play import PlayConfig
from piezod.control.law.compensated import limits_of
from piezod.control.table_guard import TableGuard
from piezod.devices.played_axis import AxisRecord, AxisTable
from piezod.experiment.play.command import command_of, legal_interval_ns
from piezod.experiment.play.learn import LearnedPlay, PassReport, learn
from piezod.experiment.play.response import (
    KnownResponse,
    MultisineSettings,
    measure_response,
    stored_response,
)
from piezod.experiment.play.stored import Conditions, find_table, model_sha256
from piezod.experiment.play.tables import TableMaker
from piezod.experiment.play.task import KnownAxis, LearningTask, PlaySettings
from piezod.experiment.play.zeroed import ZeroedAxis
from piezod.experiment.virtual.identify import IdentifiedAxis, identify_axes
from piezod.experiment.virtual.stage import VirtualStage, opened

Progress = Callable[[str, float], None]
"""Called with the present step and the share of the experiment that is done."""


@dataclass(frozen=True, eq=False)
class PlayedResult:
    """What was played on one axis.

    Attributes:
        axis: Name of the axis.
        identified: Its model.
        response: Its response.
        conditions: Conditions of its tables.
        plays: The learned waveforms, in order.
        notes: Notes on stored tables, for people.
    """

    axis: str
    identified: IdentifiedAxis
    response: KnownResponse
    conditions: Conditions
    plays: tuple[LearnedPlay, ...]
    notes: tuple[str, ...]


class VirtualAxis:
    """Implements `PlayedStage` for one axis of a virtual stage.

    Args:
        stage: The stage.
        name: Name of the axis.
        guard: Guard of its tables.
        rest_v: Voltage at rest, in V.
        rest_s: Rest before each play, in s.
    """

    def __init__(
        self, stage: VirtualStage, name: str, guard: TableGuard, rest_v: float, rest_s: float
    ) -> None:
        self._stage, self._name, self._guard = stage, name, guard
        self._rest_v, self._rest_s = rest_v, rest_s

    def rest(self) -> float:
        """Go to rest; return the rest voltage, in V.

        The read-back voltage has noise, which may be beyond a limit.
        """
        self._stage.go_to_rest(self._rest_s)
        return self._rest_v

    def play(self, table: AxisTable) -> AxisRecord:
        """Play a table that the guard has checked; return its record."""
        return self._stage.play(self._name, table, self._guard)


def run_plays(
    config: ExperimentConfig, play: PlayConfig, progress: Progress, tables: Path | None = None
) -> list[PlayedResult]:
    """Learn every waveform on every axis, one axis after the other, in virtual time.

    Args:
        config: The experiment.
        play: Its waveforms.
        progress: Called as the experiment advances.
        tables: Folder of tables to begin with, if their conditions agree; None for none.

    Raises:
        ConfigError: If a model file or a table file cannot be used.
        DataError: If a record cannot be used, or a command leaves its range.
        DeviceError: If a device cannot be opened, does not play, or refuses a table.
        ModelError: If a gain is not safe.
    """
    plays = len(config.axes) * (1 + len(play.waves) * (play.passes + 2))
    meter = _Meter(progress, plays)
    with opened(config, lambda _: None) as stage:
        meter.begin("identification")
        identified = identify_axes(stage, config)
        stage.rest(config.settle_s)
        return [
            _AxisPlays(stage, config, play, name, one).run(meter, tables)
            for name, one in identified.items()
        ]


class _Meter:
    """Turns the number of plays into a share of the experiment."""

    def __init__(self, progress: Progress, plays: int) -> None:
        self._progress, self._plays, self._done = progress, plays, 0

    def begin(self, label: str) -> None:
        self._progress(label, min(1.0, self._done / self._plays))

    def done(self, label: str) -> None:
        self._done += 1
        self.begin(label)


class _AxisPlays:
    """The plays of one axis."""

    def __init__(
        self,
        stage: VirtualStage,
        config: ExperimentConfig,
        play: PlayConfig,
        name: str,
        identified: IdentifiedAxis,
    ) -> None:
        axis, limits = config.axes[name], limits_of(config.axes[name])
        able = stage.played(name).capabilities
        guard = TableGuard(limits, axis.limits.rest_v, able.at_end, able.cycles)
        self._play, self._identified, self._name = play, identified, name
        self._interval_ns = legal_interval_ns(able, play.interval_us)
        resting = VirtualAxis(stage, name, guard, axis.limits.rest_v, config.settle_s)
        self._stored = axis.response
        self._conditions = Conditions(
            name,
            stage.identity(name),
            model_sha256(identified.model),
            axis.compensator.sensor_delay_s,
            axis.limits.rest_v,
        )
        self._maker = TableMaker(
            identified.model,
            self._interval_ns,
            (limits.drive_min_v, limits.drive_max_v),
            limits.slew_v_per_s,
        )
        conditioning_v = self._maker.conditioning(axis.limits.rest_v)
        # Zeroed once: the stage drifts between the waveforms.
        self._stage = ZeroedAxis(resting, self._interval_ns, conditioning_v)

    def run(self, meter: _Meter, tables: Path | None) -> PlayedResult:
        """Measure the response, then learn every waveform."""
        meter.begin(f"axis {self._name}, response")
        response = self._response()
        meter.done(f"axis {self._name}")
        creep, delay_s = self._identified.model.creep, self._conditions.sensor_delay_s
        known = KnownAxis(self._maker, creep, response, delay_s)
        plays, notes = [], []
        for wave in self._play.waves:
            command = command_of(wave, self._interval_ns)
            first_um = None
            if tables is not None:
                first_um, note = find_table(tables, self._conditions, command)
                notes.append(f"Axis {self._name}, {wave.name}: {note}.")
            plays.append(self._learn(known.task(command, self._settings, first_um), meter))
        return PlayedResult(
            self._name, self._identified, response, self._conditions, tuple(plays), tuple(notes)
        )

    def _response(self) -> KnownResponse:
        """Return the configured response, or measure it."""
        if self._stored is not None:
            return stored_response(self._stored, self._interval_ns)
        play, range_um = self._play, self._identified.model.position_um
        settings = MultisineSettings(
            self._interval_ns, play.lowest_hz, play.highest_hz, play.amplitude_pct / 100.0
        )
        return measure_response(self._stage, self._maker, range_um, settings)

    @property
    def _settings(self) -> PlaySettings:
        return PlaySettings(self._play.passes, self._play.settle_s, self._play.record_s)

    def _learn(self, task: LearningTask, meter: _Meter) -> LearnedPlay:
        def report(done: PassReport) -> None:
            meter.done(f"axis {self._name}, {task.given.name}: {done.label}")

        # Without a learned table, the inverse model alone shows what the response adds.
        return learn(self._stage, task, report, compare=task.first_um is None)
