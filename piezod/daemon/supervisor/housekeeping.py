"""What has to be written out beside the service: the loop's events, flights, the audit."""

import asyncio
from typing import Final

from piezod.daemon.logging import logger
from piezod.daemon.supervisor.stage_link import StageLink

EACH_S: Final = 0.5

_log = logger("loop")


class Housekeeping:
    """Hands on what the loop tells, and brings to the disk what belongs there.

    Args:
        link: The stage.
    """

    def __init__(self, link: StageLink) -> None:
        self._link = link

    def log_events(self) -> None:
        """Log what has happened in the loop since the last call; does not block."""
        events, lost = self._link.loop.events.read()
        for event in events:
            self._link.recordings_of_stage.note(event)
            told = {name: value for name, value in event._asdict().items() if value != ""}
            severity, kind = told.pop("severity"), told.pop("kind")
            getattr(_log, severity)(kind, **told)
        if lost:
            _log.warning("events lost", count=lost)

    async def run(self) -> None:
        """Write flights and sync the audit until cancelled; the disk is waited for elsewhere."""
        while True:
            await asyncio.sleep(EACH_S)
            try:
                await self._link.recordings_of_stage.write_flight(self._link.loop)
                await asyncio.to_thread(self._link.audit_of_stage.sync)
            except Exception:  # noqa: BLE001 - whatever a disk does to it, the stage goes on
                _log.exception("housekeeping failed")

    async def close(self) -> None:
        """Write out what is left, end a recording, and close the audit."""
        self.log_events()
        await self._link.recordings_of_stage.write_flight(self._link.loop, at_once=True)
        await self._link.recordings_of_stage.close()
        try:
            self._link.audit_of_stage.close()
        except OSError as error:
            _log.error("audit not closed", why=str(error))
