"""`piezod response`: the frequency response of an axis."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from piezod.cli.identify.options import check_out
from piezod.cli.identify.response_options import (
    AmplitudeOption,
    AxisArgument,
    FromOption,
    HighOption,
    LowOption,
    OffsetOption,
    OutOption,
    PeriodsOption,
)
from piezod.cli.interrupt import unwinding
from piezod.cli.options import JsonOption
from piezod.cli.progress import progress_bar
from piezod.cli.stage_options import SocketOption, StageOption, connect

if TYPE_CHECKING:
    from piezod.experiment.response.plan import Wanted
    from piezod.records.response_record import ResponseRecord


def response(  # noqa: PLR0913, PLR0917 - each argument is an option
    axis: AxisArgument = None,
    from_file: FromOption = None,
    offset_v: OffsetOption = None,
    amplitude_v: AmplitudeOption = None,
    low_hz: LowOption = None,
    high_hz: HighOption = None,
    periods: PeriodsOption = None,
    out: OutOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Measure the frequency response of an axis: gain, delay and modes.

    A running stage is driven from rest to the middle of its voltages, and there by small steps and
    by a multisine, a sum of sinusoids of many frequencies. It is disarmed at the end. With --from a
    recording is evaluated, and no stage is driven.

    Prints the small-signal gain in µm/V, the delay, and the modes with their damping. Only
    frequencies below half of the rate can be measured.
    """
    from piezod.experiment.response.plan import Wanted

    check_out(out)
    wanted = Wanted(tuple(offset_v or ()), amplitude_v, low_hz, high_hz, periods)
    if from_file is None:
        record = _measured(axis, wanted, stage, socket)
    else:
        record = _evaluated(from_file, axis, wanted, (stage, socket))
    _show(record, out, json=json)


def _measured(
    axis: str | None, wanted: "Wanted", stage: str | None, socket: Path | None
) -> "ResponseRecord":
    from piezod.experiment.live.response import response_live

    with unwinding(), connect(stage, socket) as client, progress_bar() as progress:
        return response_live(client, axis, wanted, progress)


def _evaluated(
    file: Path, axis: str | None, wanted: "Wanted", only_live: tuple[object, ...]
) -> "ResponseRecord":
    from piezod.experiment.response.recorded import response_of_file

    if any((*wanted, *only_live)):
        message = "only AXIS, --out and --json go with it: nothing is driven"
        raise typer.BadParameter(message, param_hint="'--from'")
    return response_of_file(file, axis)


def _show(record: "ResponseRecord", out: Path | None, *, json: bool) -> None:
    from piezod.cli.identify.response_view import as_document, print_response
    from piezod.cli.output import new_console, print_json
    from piezod.experiment.response.outputs import write_response

    written = write_response(out, record, datetime.now(UTC)) if out else None
    if json:
        print_json(as_document(record, written))
    else:
        print_response(new_console(), record, written)
