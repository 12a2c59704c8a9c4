"""The response in a recording of any movement."""

from pathlib import Path
from typing import Final

import numpy as np

from piezod.experiment.fit.recorded import columns_of_recording, on_cycles
from piezod.experiment.fit.source import columns_of_table
from piezod.experiment.prefix import prefix_errors
from piezod.experiment.response.judgement import judged
from piezod.experiment.response.measurement import measured_in_recording
from piezod.records.recording.reader import is_recording, read_telemetry
from piezod.records.response_record import ResponseRecord

REMEDY: Final = (
    "record for longer, with a drive that contains more frequencies, or measure the running stage "
    "without --from"
)


def response_of_file(path: Path, axis: str | None) -> ResponseRecord:
    """Return the response in a file, and its model.

    Args:
        path: A table of time, drive and position in any known format, or a recording of a stage.
        axis: Axis of a recording; None for the only one.

    Raises:
        DataError: If the file cannot be used, or its drive excites too little; the text starts with
            its name.
        OSError: If the file cannot be read.
    """
    if is_recording(path):
        name = read_telemetry(path, 0.0, 0.0).chosen_axis(axis)
        columns, notes = columns_of_recording(path, axis, on_cycles)
    else:
        name = axis or "x"
        columns, notes, understood = columns_of_table(path, command="import")
        notes = (*understood, *notes)
    rate_hz = (columns["t_s"].size - 1) / float(np.ptp(columns["t_s"]))
    with prefix_errors(str(path)):
        about = measured_in_recording(columns, rate_hz)
        return judged(name, path.name, "recording", rate_hz, [about], REMEDY, notes)
