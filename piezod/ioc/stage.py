"""One stage as records: its telemetry, its status, and what clients write."""

import asyncio
import time
from collections.abc import AsyncGenerator, Callable, Mapping
from contextlib import aclosing, suppress
from pathlib import Path
from typing import Final

from piezod.client import AsyncStageClient
from piezod.client.daemon_link import DaemonLink
from piezod.client.limits import limits_in
from piezod.config.daemon import OnTargetConfig
from piezod.errors import ClientError, NotRunningError
from piezod.ioc import values
from piezod.ioc.actions import KEEP, RENEW_EACH_S
from piezod.ioc.axis_motor import AxisMotor
from piezod.ioc.readings import DOWN, FAULTY, Reading
from piezod.ioc.records import Motor, Names, Records
from piezod.ioc.writes import Writes
from piezod.messages.answers import Status
from piezod.messages.documents import Document
from piezod.messages.telemetry import Telemetry

RATE_HZ: Final = 50.0
"""Rate of the telemetry: the highest one, for the histories."""
SHOW_EACH_S: Final = 0.1
"""Time between two updates of the records, in s; a change of state is shown at once."""
HISTORY_EACH_S: Final = 1.0
SILENT_S: Final = 1.5
"""Time without telemetry after which the records are invalid, in s."""
_AGAIN_S: Final = 0.3
_STATUS_EACH_S: Final = 1.0
_STATUS_AT_MOST_EACH_S: Final = 0.2
_CONFIG_EACH_S: Final = 5.0


class IocStage:
    """A stage with its records.

    Args:
        socket: Socket of the daemon.
        names: Names of the records.
        report: Gets the text of each refusal.
    """

    def __init__(self, socket: Path, names: Names, report: Callable[[str], None]) -> None:
        self._socket, self.names, self._report = socket, names, report
        self._link = DaemonLink(socket, "ioc")
        self._changed, self._came_up = asyncio.Event(), asyncio.Event()
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
        self.writes = Writes(self._link, self.names, records, self._motors, self._report)

    async def run(self) -> None:
        """Show the stage until the task is cancelled; then release the lease."""
        self._set_down()
        try:
            async with asyncio.TaskGroup() as group:
                for work in (self._follow, self._ask, self._ask_config, self._keep_lease):
                    group.create_task(work())
        finally:
            await self._link.close()

    # ------------------------------------------------------------ from the daemon to the records

    async def _follow(self) -> None:
        """Show the telemetry; without it the records are invalid."""
        while True:
            try:
                async with aclosing(self._telemetry()) as intervals:
                    await self._show(intervals)
            except (ClientError, TimeoutError):
                self._set_down()
            except LookupError as error:
                what = f"{self.names.prefix}STATE: the stage has no axis {error} any more"
                raise NotRunningError(what, "start `piezod ioc` again") from error
            await asyncio.sleep(_AGAIN_S)

    async def _telemetry(self) -> AsyncGenerator[Telemetry, None]:
        async with (
            AsyncStageClient(socket=self._socket, name="ioc") as client,
            aclosing(client.telemetry(RATE_HZ)) as intervals,
        ):
            while True:
                async with asyncio.timeout(SILENT_S):
                    interval = await anext(intervals)
                yield interval

    async def _show(self, intervals: AsyncGenerator[Telemetry, None]) -> None:
        before: object = None
        late_us, shown_s, history_s = 0.0, 0.0, 0.0
        async for interval in intervals:
            self._set_up()
            late_us = max(late_us, interval.late_max_us or 0.0)
            for axis, history in self._histories.items():
                history.feed(interval.t_s, interval.axes[axis])
            state = _steady(interval)
            now_s = time.monotonic()
            if state == before and now_s - shown_s < SHOW_EACH_S:
                continue
            if state != before:
                self._changed.set()
            before, shown_s = state, now_s
            self._show_interval(interval, late_us)
            late_us = 0.0
            if now_s - history_s >= HISTORY_EACH_S:
                history_s = now_s
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
        """Show faults, lease and recordings, each second and when something has changed."""
        while True:
            with suppress(ClientError):
                status = await self._link.status()
                recordings = await self._link.recordings()
                if self._up:
                    self._set(values.of_status(status))
                    self._set(values.of_recordings(recordings))
            await asyncio.sleep(_STATUS_AT_MOST_EACH_S)
            await _wait(self._changed, _STATUS_EACH_S)

    async def _ask_config(self) -> None:
        """Take the limits of the configuration in force, which a reload may change."""
        while True:
            with suppress(ClientError):
                self._take_config(await self._link.config())
            await _wait(self._came_up, _CONFIG_EACH_S)

    def _take_config(self, config: Document) -> None:
        if not self._up:
            return
        self._set({"LOOP:RATE": Reading(config["rate_hz"])})
        limits = limits_in(config)
        default_um = OnTargetConfig().tolerance_um
        for axis, motor in self._motors.items():
            on_target = config["axes"][axis].get("on_target", {})
            motor.limit(limits.get(axis), on_target.get("tolerance_um", default_um))

    async def _keep_lease(self) -> None:
        while True:
            await asyncio.sleep(RENEW_EACH_S)
            if self._records.get(f"{self.names.prefix}LEASE") == KEEP:
                await self.writes.do("", "LEASE", KEEP)

    def _set_up(self) -> None:
        if not self._up:
            self._up = True
            self._shown.clear()
            self._set({"CONNECTED": Reading(True)})
            self._changed.set()
            self._came_up.set()

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


async def _wait(event: asyncio.Event, longest_s: float) -> None:
    """Wait for an event, at most for some time in s; then clear it."""
    with suppress(TimeoutError):
        async with asyncio.timeout(longest_s):
            await event.wait()
    event.clear()


def _steady(interval: Telemetry) -> object:
    """Return what is shown at once if it changes."""
    axes = [(axis.mode, axis.motion, axis.on_target) for axis in interval.axes.values()]
    return interval.state, interval.shadow, interval.faults, axes
