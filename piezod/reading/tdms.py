"""Tables in .tdms files of LabVIEW."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from piezod.errors import DataError
from piezod.reading.extra import library
from piezod.reading.table import MOST_VALUES, Clock, Column, FloatArray, Table, as_column


def open_tdms(file: Path, part: str) -> Table:
    """Return the table of the channels of a .tdms file.

    Args:
        file: The file.
        part: Group that counts, as in "/Measured"; empty for all.

    Raises:
        DataError: If it has no channels of numbers, is damaged, or npTDMS is not installed.
    """
    nptdms = library("nptdms", "a .tdms file", file)
    wanted = part.strip("/")
    try:
        opened = nptdms.TdmsFile.read_metadata(file)
        channels = [
            channel
            for group in opened.groups()
            if wanted in {"", group.name}
            for channel in group.channels()
            if channel.dtype.kind in "biuf" and 1 < len(channel) <= MOST_VALUES
        ]
    except Exception as error:
        raise DataError(f"{file}: the .tdms file is damaged: {error}") from error
    if not channels:
        groups = ", ".join(group.name for group in opened.groups()) or "no group"
        raise DataError(f"{file}: there are no channels of numbers in {part or 'it'}; has {groups}")
    names = [channel.name for channel in channels]
    columns = tuple(
        Column(
            channel.name if names.count(channel.name) == 1 else channel.path.replace("'", ""),
            str(channel.properties.get("unit_string", "")),
            last=channel.name,
        )
        for channel in channels
    )

    def read(numbers: Sequence[int]) -> list[FloatArray]:
        with nptdms.TdmsFile.open(file) as again:
            return [_values(file, again, channels[number]) for number in numbers]

    form = f".tdms, {part}" if part else ".tdms"
    return Table(file, form, columns, read, clock=_clock(channels))


def _values(file: Path, opened: Any, channel: Any) -> FloatArray:
    place = f"{file}: {channel.name}"
    try:
        return as_column(opened[channel.group_name][channel.name][:], place)
    except (ValueError, TypeError, KeyError, IndexError, EOFError) as error:
        raise DataError(f"{place}: the channel is damaged: {error}") from error


def _clock(channels: Sequence[Any]) -> Clock | None:
    """Return the time of the waveforms, if all have the same."""
    times = {
        (
            float(each.properties.get("wf_start_offset", 0.0)),
            float(each.properties.get("wf_increment", 0.0)),
        )
        for each in channels
    }
    if len(times) != 1:
        return None
    ((start_s, step_s),) = times
    return Clock(start_s, step_s, f"wf_increment is {step_s:g} s") if step_s > 0.0 else None
