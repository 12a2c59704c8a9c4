"""One stage as records: its telemetry, its status, and what clients write."""

import asyncio
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from piezod.client.daemon_link import DaemonLink
from piezod.client.mirror import StageMirror, steady
from piezod.client.mover import StageMover
from piezod.errors import ClientError, NotRunningError
from piezod.ioc import values
from piezod.ioc.axis_motor import AxisMotor
from piezod.ioc.readings import DOWN, FAULTY, Reading
from piezod.ioc.records import Motor, Names, Records
from piezod.ioc.writes import Writes
from piezod.messages.answers import Status
from piezod.messages.telemetry import Telemetry

SHOW_EACH_S: Final = 0.1
"""Time between two updates of the records, in s; a change of state is shown at once."""
HISTORY_EACH_S: Final = 1.0
_CONFIG_EACH_S: Final = 5.0


class IocStage:
    """A stage with its records.

    Args:
        socket: Socket of the daemon.
        names: Names of the records.
        report: Gets the text of each refusal.
    """

    def __init__(self, socket: Path, names: Names, report: Callable[[str], None]) -> None:
        self.names, self._report = names, report
        self._mirror = StageMirror(DaemonLink(socket, "ioc"))
        self._mover = StageMover(self._mirror.link)
        self._steady: object = None
        self._late_us = self._shown_s = self._history_s = 0.0
        self._shown: dict[str, Reading] = {}
        self._histories = {axis: values.History() for axis in names.axes}
        self._up = False

    def bind(self, records: Records, motors: Mapping[str, Motor], status: Status) -> None:
        """Take the records, when they have been made.

        Args:
            records: All records.
            motors: Motor records by the names of the axes.
            status: The status of the stage, which says what its axes have.
        """
        self._records = records
        self._sensors = {name: axis.has_sensor for name, axis in status.axes.items()}
        self._motors = {
            axis: AxisMotor(motor, has_sensor=self._sensors[axis]) for axis, motor in motors.items()
        }
        self.writes = Writes(
            self._mirror, self._mover, self.names, records, self._motors, self._report
        )

    async def run(self) -> None:
        """Show the stage until the task is cancelled; then release the lease."""
        self._set_down()
        try:
            async with asyncio.TaskGroup() as group:
                for work in (self._follow, self._ask):
                    group.create_task(work())
        finally:
            await self._mirror.close()
            await self._mover.close()

    # ------------------------------------------------------------ from the daemon to the records

    async def _follow(self) -> None:
        """Show the telemetry; without it the records are invalid."""
        async for found in self._mirror.following():
            if isinstance(found, ClientError):
                self._set_down()
                continue
            try:
                self._show(found)
            except LookupError as error:
                what = f"{self.names.prefix}STATE: the stage has no axis {error} any more"
                raise NotRunningError(what, "start `piezod ioc` again") from error

    def _show(self, interval: Telemetry) -> None:
        self._set_up()
        self._late_us = max(self._late_us, interval.late_max_us or 0.0)
        for axis, history in self._histories.items():
            history.feed(interval.t_s, interval.axes[axis])
        now_s, now = time.monotonic(), steady(interval)
        if now == self._steady and now_s - self._shown_s < SHOW_EACH_S:
            return
        self._steady, self._shown_s = now, now_s
        self._show_interval(interval, self._late_us)
        self._late_us = 0.0
        if now_s - self._history_s >= HISTORY_EACH_S:
            self._history_s = now_s
            for axis, history in self._histories.items():
                self._set_axis(axis, history.readings())

    def _show_interval(self, interval: Telemetry, late_us: float) -> None:
        readings = dict(values.of_interval(interval))
        if interval.late_max_us is not None:
            readings["LOOP:LATE"] = Reading(late_us)
        self._set(readings)
        for axis, motor in self._motors.items():
            now = interval.axes[axis]
            self._set_axis(axis, values.of_axis(now, has_sensor=self._sensors[axis]))
            motor.feed(interval.state, now)

    async def _ask(self) -> None:
        """Show faults, lease, recordings and limits, each second and when something has changed."""
        while True:
            with suppress(ClientError):
                status = await self._mirror.status()
                recordings = await self._mirror.link.recordings()
                facts = await self._mirror.facts(_CONFIG_EACH_S)
                if self._up:
                    self._set(values.of_status(status))
                    self._set(values.of_recordings(recordings))
                    for axis, motor in self._motors.items():
                        now, has_sensor = status.axes[axis], self._sensors[axis]
                        self._set_axis(axis, values.of_axis(now, has_sensor=has_sensor))
                        motor.limit(facts[axis])
            await self._mirror.until_changed()

    def _set_up(self) -> None:
        if not self._up:
            self._up = True
            self._shown.clear()
            self._set({"CONNECTED": Reading(True)})
            self._mirror.look_again()

    def _set_down(self) -> None:
        if not self._up and self._shown:
            return
        self._up = False
        for name, record in self.names.all():
            if not record.kind.is_set and record.name not in {"CONNECTED", "MESSAGE"}:
                self._records.set_alarm(name, DOWN)
        for motor in self._motors.values():
            motor.down()
        self._set({"CONNECTED": Reading(False, FAULTY)})

    def _set(self, readings: Mapping[str, Reading]) -> None:
        for name, reading in readings.items():
            self._set_record(f"{self.names.prefix}{name}", reading)

    def _set_axis(self, axis: str, readings: Mapping[str, Reading]) -> None:
        for name, reading in readings.items():
            self._set_record(self.names.of_axis(axis, name), reading)

    def _set_record(self, name: str, reading: Reading) -> None:
        if self._shown.get(name) != reading:
            self._shown[name] = reading
            self._records.set(name, reading)
