"""Writes the loop's events to the log, and flight records and audit log to the disk."""

import asyncio
from typing import Final

from piezod.daemon.logging import logger
from piezod.daemon.stage.running_stage import RunningStage

PERIOD_S: Final = 0.5

_log = logger("loop")


class Housekeeping:
    """Handles the events of the loop, and writes what belongs on the disk."""

    def __init__(self, link: RunningStage) -> None:
        self._link = link

    def log_events(self) -> None:
        """Log the events of the loop since the last call, without blocking."""
        events, lost = self._link.loop.events.read()
        for event in events:
            self._link.stage_recordings.take_event(event)
            self._link.count_fault(event)
            fields = {name: value for name, value in event._asdict().items() if value != ""}
            severity, kind = fields.pop("severity"), fields.pop("kind")
            getattr(_log, severity)(kind, **fields)
        if lost:
            _log.warning("events lost", count=lost)

    async def run(self) -> None:
        """Repair old recordings; then write files and report faults until cancelled."""
        await self._link.stage_recordings.repair()
        while True:
            await asyncio.sleep(PERIOD_S)
            try:
                self._link.report_faults()
                await self._link.look_at_config()
                await self._link.stage_recordings.write_flight(self._link.loop)
                await asyncio.to_thread(self._link.stage_audit.sync)
            except Exception:  # noqa: BLE001 - a failing disk must not stop the stage
                _log.exception("housekeeping failed")

    async def close(self) -> None:
        """Write the last events and flight record, end a recording, and close the audit log."""
        # The events first: a fault among them starts the flight record.
        self.log_events()
        await self._link.stage_recordings.write_flight(self._link.loop, at_once=True)
        await self._link.stage_recordings.close()
        try:
            await asyncio.to_thread(self._link.stage_audit.close)
        except OSError as error:
            _log.error("audit not closed", why=str(error))
