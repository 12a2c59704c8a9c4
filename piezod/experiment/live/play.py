"""Learns a periodic waveform on a running stage, whose device plays it by its own clock."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from piezod.client import StageClient
from piezod.client.request_bodies import tupled
from piezod.config.document import Document, SourcePlace
from piezod.config.fields import ConfigModel, Context
from piezod.config.play import IntervalUs, Passes, WaveConfig
from piezod.config.quantities import PauseS
from piezod.config.validate import validate
from piezod.errors import DataError, PiezodError, RefusedError
from piezod.experiment.live.plan import out_of_range
from piezod.experiment.live.running_axis import playing_axis
from piezod.experiment.live.setup import LiveSetup, read_setup
from piezod.experiment.live.stage import LiveStage
from piezod.experiment.play.axis import PlayingAxis
from piezod.experiment.play.command import command_of
from piezod.experiment.play.learn import LearnedPlay, PassReport, learn
from piezod.experiment.play.stored import find_table, store_table
from piezod.experiment.play.task import KnownAxis, PlaySettings

REST_S = 1.0
"""Rest at the rest voltage before each play, in s."""
_TOO_LARGE = "too_large"


class _Wanted(ConfigModel):
    """Arguments of `learn_waveform`."""

    wave: WaveConfig
    passes: Passes
    interval_us: IntervalUs
    settle_s: PauseS
    record_s: PauseS

    @property
    def settings(self) -> PlaySettings:
        """Settings of the plays."""
        return PlaySettings(self.passes, self.settle_s, self.record_s)


def learn_waveform(  # noqa: PLR0913 - each is an option of `piezod play`
    client: StageClient,
    wave: WaveConfig | Mapping[str, Any],
    passes: int = 6,
    *,
    interval_us: float = 50.0,
    settle_s: float = 1.0,
    record_s: float = 1.0,
    axis: str | None = None,
    tables: Path | None = None,
    report: Callable[[PassReport], None] = lambda _report: None,
    note: Callable[[str], None] = lambda _text: None,
) -> LearnedPlay:
    """Learn the table of a periodic waveform on a running stage, pass by pass.

    The table is made by the inverse model and the response of the axis, played, and corrected by
    the error that the sensor shows, until that is at the noise or no longer falls. The stage is
    disarmed at the end in any case.

    Args:
        client: A connection to the daemon of the stage.
        wave: The waveform: `command_um` with one period of the position, in µm, and a `name`, as in
            the file of `piezod play`.
        passes: Largest number of corrections, 0 to 50.
        interval_us: Time between two points of the table, in µs.
        settle_s: Time of the waveform before the periods that count, in s.
        record_s: Time of the periods that count, in s; at least four periods do.
        axis: Name of the axis; None for the only one.
        tables: Folder of learned tables: the play begins with one whose conditions agree, and the
            learned one is stored there. None for neither.
        report: Called after each play.
        note: Called with what to know about stored tables.

    Raises:
        ClientError: If a request is refused, or the stage leaves the expected states.
        ConfigError: If an argument is not valid, or a stored table.
        DataError: If the axis has no sensor or no model, the command leaves its range, or nothing
            was learned.
        ModelError: If a model in use is not valid.
        OSError: If the table cannot be stored.
    """
    wanted = _wanted(
        wave, passes=passes, interval_us=interval_us, settle_s=settle_s, record_s=record_s
    )
    setup = read_setup(client)
    name = setup.measured_axis(axis, "learning")
    _require_range(wanted.wave, setup, name)
    command = command_of(wanted.wave, round(1000.0 * wanted.interval_us))
    with LiveStage(client, setup, lambda _over_s: None) as stage:
        stage.arm_at_rest(REST_S)
        playing = playing_axis(stage, setup, name, command.interval_ns, REST_S)
        known, first_um = measured_axis(playing), None
        if tables is not None:
            first_um, text = find_table(tables, playing.conditions, command)
            note(text)
        learned = learn(playing.stage, known.task(command, wanted.settings, first_um), report)
        stage.disarm()
    if tables is not None:
        note(f"stored as {store_table(tables, learned, playing.conditions)}")
    return learned


def _require_range(wave: WaveConfig, setup: LiveSetup, name: str) -> None:
    """Refuse an axis without a model, and a waveform out of its range."""
    setup.model_of(name)
    for problem in out_of_range(wave.name, name, setup.axes[name], *wave.command_um.bounds()):
        raise DataError(problem)


def _wanted(wave: WaveConfig | Mapping[str, Any], **settings: float) -> _Wanted:
    if not isinstance(wave, WaveConfig):
        wave = {"name": "waveform"} | {key: tupled(value) for key, value in wave.items()}
    document = Document("learn_waveform", {"wave": wave, **settings}, {(): SourcePlace(0, 0)}, {})
    return validate(document, _Wanted, Context())


def measured_axis(axis: PlayingAxis) -> KnownAxis:
    """Return what is known of an axis, measured with the largest amplitude that it accepts."""
    return axis.slowly_known(RefusedError, _check_size)


def _check_size(error: PiezodError) -> None:
    """Refuse a table that no smaller amplitude makes smaller."""
    if isinstance(error, RefusedError) and error.code == _TOO_LARGE:
        what = f"the table that measures the response does not fit into a request: {error}"
        raise DataError(f"{what}; a longer interval between points makes it smaller") from error
