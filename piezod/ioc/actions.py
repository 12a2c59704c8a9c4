"""What the records that clients write make the stage do."""

from collections.abc import Awaitable, Callable, Mapping
from itertools import count
from typing import Any, Final

from piezod.client.mover import StageMover
from piezod.config.waveforms.swings import SWINGS
from piezod.errors import RefusedError
from piezod.ioc.readings import FAULTY, OK, Reading
from piezod.ioc.records import Names, Records
from piezod.ioc.table import LONGEST_RECORD, MODES, TABLE, WAVES, wave_record
from piezod.messages.documents import Document

_KEEP: Final = 1
"""Value of the record LEASE for a lease that is kept."""


class Actions:
    """The actions of one stage. Each raises a ClientError if the daemon refuses.

    Args:
        mover: Connection to the daemon, with its lease.
        names: Names of the records.
        records: The records, with the settings.
    """

    def __init__(self, mover: StageMover, names: Names, records: Records) -> None:
        self._mover, self._link = mover, mover.link
        self._names, self._records = names, records

    async def do_stage(self, name: str, value: Any) -> None:
        """Carry out what a client has written to a record of the stage."""
        link = self._link
        plain: Mapping[str, Callable[[], Awaitable[object]]] = {
            "ARM": link.arm,
            "DISARM": link.disarm,
            "HOLD": link.hold,
            "RESUME": link.resume,
            "STOP": link.stop,
            "ESTOP": link.estop,
            "RESET": link.reset,
            "CONDITION": link.condition,
            "REC:STOP": link.stop_recording,
        }
        if name in plain:
            await plain[name]()
        elif name == "REC:START":
            label = str(self._records.get(f"{self._names.prefix}REC:LABEL"))
            await link.start_recording(label or None)
        elif name == "LEASE":
            mover = self._mover
            await (mover.take_lease(self) if value == _KEEP else mover.return_lease(self))

    async def do_axis(self, axis: str, name: str, value: Any) -> None:
        """Carry out what a client has written to a record of an axis."""
        if name == "MODE":
            await self._link.mode(MODES[value], axis=axis)
        elif name == "ZERO":
            await self._link.zero(axis=axis)
        elif name == "WAVE:START":
            waveform, duration_s = self._waveform(axis)
            await self._link.wave({axis: waveform}, duration_s)
        elif name == "PLAY:START":
            table_v = self._array(axis, "PLAY:TABLE")
            interval_s = self._number(axis, "PLAY:INTERVAL")
            cycles = int(self._number(axis, "PLAY:CYCLES"))
            await self._link.play(table_v, interval_s=interval_s, cycles=cycles, axis=axis)
        elif name == "PLAY:READ":
            self._show_played(axis, await self._link.played())

    def _waveform(self, axis: str) -> tuple[Document, float]:
        """Return the waveform of the settings, and its duration in s."""
        kind = WAVES[int(self._number(axis, "WAVE:KIND"))]
        if kind == TABLE:
            positions_um = self._array(axis, "WAVE:TABLE")
            interval_s = self._number(axis, "WAVE:INTERVAL")
            if not positions_um:
                raise RefusedError("WAVE:TABLE is empty", "write positions in um to it", "value")
            points = tuple(zip((i * interval_s for i in count()), positions_um, strict=False))
            return {"kind": "points", "points": points}, len(positions_um) * interval_s
        numbers = {each.key: self._number(axis, wave_record(each.key)) for each in SWINGS[kind]}
        return {"kind": kind, **numbers}, self._number(axis, "WAVE:DURATION")

    def _show_played(self, axis: str, played: Document) -> None:
        """Show the record of the last play."""
        alarm = FAULTY if played["failed"] else OK
        positions = [_known(each) for each in played["position_um"][:LONGEST_RECORD]]
        readings = {
            "PLAY:DRIVE": Reading([_known(each) for each in played["drive_v"]], alarm),
            "PLAY:POS": Reading(positions, alarm),
            "PLAY:POS:INTERVAL": Reading(played["record_interval_s"], alarm),
        }
        for name, reading in readings.items():
            self._records.set(self._names.of_axis(axis, name), reading)

    def _number(self, axis: str, name: str) -> float:
        value: Any = self._records.get(self._names.of_axis(axis, name))
        return float(value)

    def _array(self, axis: str, name: str) -> tuple[float, ...]:
        values: Any = self._records.get(self._names.of_axis(axis, name))
        return tuple(float(each) for each in values)


def _known(value: float | None) -> float:
    return float("nan") if value is None else value
