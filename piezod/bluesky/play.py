"""A play: a table of voltages that the device plays by its own clock, with its record."""

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

from piezod.bluesky.connected_stage import ConnectedStage
from piezod.bluesky.motion import moving
from piezod.bluesky.recorded import Column
from piezod.client.arrival import because_of
from piezod.config.states import State
from piezod.errors import DataError, NotReachedError, RefusedError

_UNITS: Final = {"t_s": "s", "position_um": "um", "drive_v": "V"}


@dataclass(frozen=True)
class Play:
    """A table to play, for a flyer; the stage must be in READY."""

    axis: str  #: Name of the axis.
    drive_v: Sequence[float]  #: Voltages of one period, in V.
    interval_s: float  #: Time between two of them, in s.
    cycles: int  #: Number of periods.
    lead_in_v: Sequence[float] = ()  #: Voltages before the first period, in V.

    async def prepare(self, link: ConnectedStage) -> None:
        """Check the voltages; nothing moves.

        Raises:
            RefusedError: If the axis is unknown, or a voltage is out of its range.
        """
        if self.axis not in link.facts:
            what = f"no axis {self.axis}"
            raise RefusedError(what, f"axes: {', '.join(link.facts)}", "not_found")
        low_v, high_v = link.facts[self.axis].drive_v
        table_v = (*self.lead_in_v, *self.drive_v)
        if min(table_v) < low_v or max(table_v) > high_v:
            what = f"axis {self.axis}: {min(table_v):g} to {max(table_v):g} V"
            raise RefusedError(what, f"allowed: {low_v:g} to {high_v:g} V", "value")

    async def fly(self, link: ConnectedStage, file: Path, begun: asyncio.Event) -> None:
        """Let the device play, and write its record.

        Args:
            link: Connection to the stage.
            file: Where the record is written.
            begun: Set when the daemon has accepted the table.

        Raises:
            NotReachedError: If the stage was stopped or held.
            DataError: If the play has failed.
            ClientError: If the daemon refuses, or ends.
        """
        before = await _number(link)
        async with link.mirror.listening() as intervals:
            with moving(link, self.axis):
                await link.daemon.play(
                    self.drive_v,
                    interval_s=self.interval_s,
                    cycles=self.cycles,
                    lead_in_v=self.lead_in_v,
                    axis=self.axis,
                )
                begun.set()
                async for interval in intervals:
                    if interval.state == State.READY and await _number(link) != before:
                        break
                    if interval.state not in {State.READY, State.IDENT}:
                        what = f"axis {self.axis}: the stage went to {interval.state}"
                        because = f"{because_of(interval)} before the end of the play"
                        raise NotReachedError(what + because, "`piezod faults` shows more", "state")
        played = await link.daemon.played()
        if played["failed"]:
            raise DataError(f"axis {self.axis}: the play failed: {played['failed']}")
        await asyncio.to_thread(_write, played, file)

    def columns(self, recorded: Sequence[Column]) -> list[Column]:
        """Return the columns that its file has."""
        group = f"recording/axis_{self.axis}"
        datasets = {
            f"{group}/position_um": "play/position_um",
            f"{group}/in_force_v": "play/drive_v",
            "recording/cycles/t_s": "play/t_s",
        }
        return [
            each._replace(dataset=datasets[each.dataset])
            for each in recorded
            if each.dataset in datasets
        ]


async def _number(link: ConnectedStage) -> int | None:
    """Return the number of the last play; None if there was none."""
    try:
        played = await link.daemon.played()
    except RefusedError as error:
        if error.code != "not_found":
            raise
        return None
    number: int = played["number"]
    return number


def _write(played: Mapping[str, Any], file: Path) -> None:
    """Write a row for each sample of the record: its time, the position, the voltage of the table.

    Time 0 is the first voltage of the table.
    """
    position_um = np.array(played["position_um"], np.float64)  # None becomes NaN
    interval_s = played["interval_s"]
    begin_s = played["first_point"] * interval_s
    t_s = begin_s + np.arange(position_um.size) * played["record_interval_s"]
    table_v = np.concatenate([played["lead_in_v"], np.tile(played["drive_v"], played["cycles"])])
    # Half a millionth of an interval: a sample at the instant of a voltage belongs to it.
    points = np.floor(t_s / interval_s + 5e-7).astype(int)
    drive_v = table_v[np.clip(points, 0, table_v.size - 1)]
    columns = {"t_s": t_s, "position_um": position_um, "drive_v": drive_v}
    with h5py.File(file, "w-") as opened:
        group = opened.create_group("play")
        group.attrs["description"] = "A table that the device played, and its record of the sensor."
        for name, values in columns.items():
            dataset = group.create_dataset(name, data=values, chunks=(max(values.size, 1),))
            dataset.attrs["units"] = _UNITS[name]
