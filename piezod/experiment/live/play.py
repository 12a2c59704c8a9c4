"""Plays a periodic command on a running stage by the clock of its device, learned pass by pass."""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from piezod.config.play import WaveConfig
from piezod.control.law.compensated import limits_of
from piezod.errors import DataError, RefusedError
from piezod.experiment.live.setup import LiveAxis
from piezod.experiment.live.stage import LiveStage
from piezod.experiment.play.command import command_of
from piezod.experiment.play.learn import LearnedPlay, PassReport, learn
from piezod.experiment.play.response import (
    KnownResponse,
    MultisineSettings,
    measure_response,
    stored_response,
)
from piezod.experiment.play.stage import AxisRecord, AxisTable, Identity, PlayedStage
from piezod.experiment.play.stored import (
    Conditions,
    file_part,
    find_table,
    model_sha256,
    to_table_file,
    write_table,
)
from piezod.experiment.play.tables import TableMaker
from piezod.experiment.play.task import KnownAxis, PlaySettings
from piezod.experiment.play.zeroed import ZeroedAxis
from piezod.units import NS_PER_S, s_to_ns

REST_S = 1.0
"""Rest at the rest voltage before each play, in s."""
LOWEST_HZ, HIGHEST_HZ = 10.0, 3000.0
"""The multisine that measures the response of an axis which has no response file."""
AMPLITUDES = (0.03, 0.015, 0.007, 0.003)
"""Its amplitudes, as shares of the range: the first one that is not too fast for the axis."""
HIGHEST_SHARE = 0.15
"""Highest frequency of the multisine, as a share of the rate of the table, if that is lower."""


class LivePlay(NamedTuple):
    """What is played on a running stage.

    Attributes:
        axis: Name of the axis.
        wave: The periodic command.
        interval_ns: Time between two points of the table, in ns.
        settings: Settings of the plays.
        tables: Folder of learned tables: the play begins with one whose conditions agree, and the
            learned one is stored there. None for neither.
    """

    axis: str
    wave: WaveConfig
    interval_ns: int
    settings: PlaySettings
    tables: Path | None = None


class RunningAxis:
    """Implements `PlayedStage` for one axis of a running stage, which is armed and at rest.

    Args:
        stage: The stage.
        name: Name of the axis.
        rest_v: Its rest voltage, in V.

    Attributes:
        identity: Identity of the device, known after the first play.
    """

    def __init__(self, stage: LiveStage, name: str, rest_v: float) -> None:
        self._stage, self._name, self._rest_v = stage, name, rest_v
        self.identity = Identity("", "", "", "")

    def rest(self) -> float:
        """Rest; return the rest voltage, in V."""
        self._stage.pause(REST_S)
        return self._rest_v

    def play(self, table: AxisTable) -> AxisRecord:
        """Play a table, which the daemon checks; return its record."""
        played = self._stage.play(
            self._name,
            table.period_v.tolist(),
            table.lead_in_v.tolist(),
            table.interval_ns / NS_PER_S,
            table.cycles,
        )
        self.identity = Identity(**played["device"], firmware="")
        position_um = np.array(played["position_um"], dtype=np.float64)  # null becomes NaN
        interval_ns = s_to_ns(played["record_interval_s"])
        unknown = np.full(position_um.size, np.nan)
        return AxisRecord(interval_ns, position_um, unknown, int(played["first_point"]))


def play_live(
    stage: LiveStage,
    axis: LiveAxis,
    play: LivePlay,
    report: Callable[[PassReport], None],
    note: Callable[[str], None],
) -> LearnedPlay:
    """Learn the table of a command on a running stage; the stage is disarmed and at rest.

    Args:
        stage: The stage.
        axis: The axis.
        play: What is played.
        report: Called after each play.
        note: Called with what to know about stored tables.

    Raises:
        ClientError: If a request is refused, or the stage leaves the expected states.
        ConfigError: If a stored table is not valid.
        DataError: If the axis has no model, the command leaves its range, or nothing was learned.
        OSError: If the table cannot be stored.
    """
    model, config = axis.model, axis.config
    if model is None:
        raise DataError(
            f"axis {play.axis} has no model, and a table is made by its inverse: "
            "`piezod identify --live --adopt` makes one"
        )
    stage.rest(REST_S)
    stage.arm()
    limits = limits_of(config)
    range_v = limits.drive_min_v, limits.drive_max_v
    maker = TableMaker(model, play.interval_ns, range_v, limits.slew_v_per_s)
    device = RunningAxis(stage, play.axis, config.limits.rest_v)
    running = ZeroedAxis(device, play.interval_ns, maker.conditioning(config.limits.rest_v))
    if config.response is not None:
        known = stored_response(config.response, play.interval_ns)
    else:
        highest_hz = min(HIGHEST_HZ, HIGHEST_SHARE * NS_PER_S / play.interval_ns)
        lowest_hz = near_frequency_hz(LOWEST_HZ, play.interval_ns)
        settings = MultisineSettings(play.interval_ns, lowest_hz, highest_hz, AMPLITUDES[0])
        known = _measured(running, maker, model.position_um, settings)
    of = KnownAxis(maker, model.creep, known, config.compensator.sensor_delay_s)
    command = command_of(play.wave, play.interval_ns)
    if play.tables is None:
        return learn(running, of.task(command, play.settings), report)
    conditions = Conditions(
        play.axis,
        device.identity,
        model_sha256(model),
        config.compensator.sensor_delay_s,
        config.limits.rest_v,
    )
    found = find_table(play.tables, conditions, command)
    note(found.note)
    learned = learn(running, of.task(command, play.settings, found.wanted_um), report)
    path = play.tables / f"table_{play.axis}_{file_part(command.name)}.yaml"
    write_table(path, to_table_file(learned, conditions, datetime.now().astimezone()))
    note(f"stored as {path.name}")
    return learned


def near_frequency_hz(frequency_hz: float, interval_ns: int) -> float:
    """Return the frequency nearest to this one with a whole number of points per period, in Hz.

    The clocks of some devices, of 24 µs for example, do not divide a period of 0.1 s.
    """
    n_points = max(round(NS_PER_S / frequency_hz / interval_ns), 1)
    return NS_PER_S / (n_points * interval_ns)


def _measured(
    running: PlayedStage,
    maker: TableMaker,
    range_um: tuple[float, float],
    settings: MultisineSettings,
) -> KnownResponse:
    """Measure the response with the largest amplitude that the daemon accepts."""
    refusal = None
    for amplitude in AMPLITUDES:
        try:
            return measure_response(
                running, maker, range_um, settings._replace(amplitude=amplitude)
            )
        except RefusedError as error:
            refusal = error
    raise DataError(f"no multisine is slow enough for the axis: {refusal}")
