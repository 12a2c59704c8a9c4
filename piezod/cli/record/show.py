"""`piezod record show`: what is in a recording."""

from typing import Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.output import new_console, print_json
from piezod.cli.record.recordings import RecordingArgument, local_file
from piezod.cli.record.show_view import as_document, print_summary
from piezod.cli.stage_options import SocketOption, StageOption
from piezod.errors import DataError
from piezod.reading.hdf5_magic import is_hdf5
from piezod.records.recording.summary import summary_of


def show(
    recording: RecordingArgument,
    events: Annotated[
        int, typer.Option(metavar="N", min=0, help="Show the last N events of the log.")
    ] = 20,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Print what is in a recording.

    When and how long, late and missing cycles, states, errors in each mode, faults, models, events
    of the log. With --json also the configuration, the models and all events.
    """
    with local_file(recording, stage, socket) as file:
        if not is_hdf5(file):
            raise DataError(f"{file}: this is not an HDF5 file; needed is a recording")
        summary, size_bytes = summary_of(file), file.stat().st_size
    if json:
        print_json(as_document(recording, size_bytes, summary))
    else:
        print_summary(new_console(), recording, size_bytes, summary, events)
