"""What clients write, on its way to the daemon; and what they learn of a refusal."""

import asyncio
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from piezod.client.daemon_link import DaemonLink
from piezod.config.states import State
from piezod.errors import ClientError, RefusedError
from piezod.ioc.actions import Actions
from piezod.ioc.axis_motor import AxisMotor
from piezod.ioc.readings import Reading
from piezod.ioc.records import Names, Records
from piezod.ioc.values import text
from piezod.messages.answers import Answer

_NOTHING_DRIVEN: Final = "refused"
"""Code of the daemon's answer to `hold` if nothing is driven."""
_MOVE: Final = 2
"""Value of SPMG; those below are Stop and Pause."""
_DIRECTIONS: Final = {"TWF": 1.0, "TWR": -1.0}


class Writes:
    """The writes to the records of one stage.

    Args:
        link: Connection to the daemon.
        names: Names of the records.
        records: The records.
        motors: The axes as motor records, by their names.
        report: Gets the text of each refusal.
    """

    def __init__(
        self,
        link: DaemonLink,
        names: Names,
        records: Records,
        motors: Mapping[str, AxisMotor],
        report: Callable[[str], None],
    ) -> None:
        self._link, self._names, self._records = link, names, records
        self._motors, self._report = motors, report
        self._actions = Actions(link, names, records)
        self._loop = asyncio.get_running_loop()
        self._moving = asyncio.Lock()  # a movement that follows a stop waits for its end

    async def do(self, axis: str, name: str, value: Any) -> bool:
        """Carry out what a client has written; return whether the daemon has accepted it.

        Args:
            axis: Name of the axis; empty for a record of the stage.
            name: Name in the table.
            value: What was written.
        """
        with self._reported(f"{axis}:{name}" if axis else name) as refused:
            if axis:
                await self._actions.do_axis(axis, name, value)
            else:
                await self._actions.do_stage(name, value)
        return not refused

    def put(self, axis: str, field: str, value: float) -> bool:
        """Take what a client writes to a motor record; return whether it is accepted.

        It is called in a thread of EPICS, and does not wait for the daemon.

        Args:
            axis: Name of the axis.
            field: Field of the record.
            value: What was written.
        """
        motor = self._motors[axis]
        match field:
            case "SPMG" if value < _MOVE:
                self._start(self._stop(axis))
            case "VAL":
                return self._begin(axis, value)
            case "TWF" | "TWR" if value:
                return self._begin(axis, motor.tweaked_um(_DIRECTIONS[field]))
            case "STOP" if value:
                self._start(self._stop(axis))
            case "VELO":
                return self._is_fine(axis, "VELO", motor.why_not_speed(value))
        return True

    def _begin(self, axis: str, position_um: float) -> bool:
        """Begin a movement, if the position is allowed."""
        motor = self._motors[axis]
        why = motor.why_not(position_um)
        if why:
            motor.refused()
        else:
            motor.begin(position_um)
            self._start(self._move(axis, position_um))
        return self._is_fine(axis, "VAL", why)

    async def _move(self, axis: str, position_um: float) -> None:
        motor = self._motors[axis]
        with self._reported(f"{axis}.VAL") as refused:
            async with self._moving:
                answer = await self._link.goto(
                    position_um, axis=axis, speed_um_per_s=motor.speed_um_per_s
                )
            motor.accepted(position_um, answer)
        if refused:
            motor.rejected()

    async def _stop(self, axis: str) -> None:
        """Hold the stage; then resume at the present position, so that it can move again."""
        motor = self._motors[axis]
        running = motor.state == State.RUN
        with self._reported(f"{axis}.STOP"):
            hold = asyncio.create_task(self._link.hold())  # at once, also beside a movement
            async with self._moving:
                running = await _is_driven(hold) and running
                motor.stopped()
                if running:
                    await self._link.resume()

    def refuse(self, full: str, why: str) -> None:
        """Report that a write was refused; from any thread.

        Args:
            full: Full name of the record.
            why: The reason.
        """
        name = full.removeprefix(self._names.prefix)
        self._loop.call_soon_threadsafe(self._tell, name, why)

    def _is_fine(self, axis: str, field: str, why: str) -> bool:
        if why:
            self.refuse(f"{self._names.motor(axis)}.{field}", why)
        return not why

    @contextmanager
    def _reported(self, name: str) -> Iterator[list[str]]:
        """Report a refusal; yield a list that has its text after the block."""
        refused: list[str] = []
        try:
            yield refused
        except ClientError as error:
            refused.append(str(error))
            self._tell(name, str(error))

    def _tell(self, name: str, why: str) -> None:
        self._report(f"{self._names.prefix}{name}: {why}")
        self._records.set(f"{self._names.prefix}MESSAGE", Reading(text(f"{name}: {why}")))

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop)


async def _is_driven(hold: asyncio.Task[Answer]) -> bool:
    """Return whether a request to hold was accepted; it is refused if nothing is driven."""
    try:
        await hold
    except RefusedError as error:
        if error.code != _NOTHING_DRIVEN:
            raise
        return False
    return True
