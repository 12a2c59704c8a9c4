"""What clients write, on its way to the daemon; and what they learn of a refusal."""

import asyncio
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any, Final

from piezod.client.mirror import StageMirror
from piezod.client.mover import StageMover
from piezod.errors import ClientError, NotReachedError
from piezod.ioc.actions import Actions
from piezod.ioc.axis_motor import AxisMotor
from piezod.ioc.motor_fields import FIELDS
from piezod.ioc.readings import Reading
from piezod.ioc.records import Names, Records
from piezod.ioc.values import text

_FIELDS: Final = {field.name: field for field in FIELDS}
_MOVE: Final = 2
"""Value of SPMG; those below are Stop and Pause."""
_DIRECTIONS: Final = {"TWF": 1.0, "TWR": -1.0}


class Writes:
    """The writes to the records of one stage.

    Args:
        mirror: The stage.
        mover: Moves and stops it.
        names: Names of the records.
        records: The records.
        motors: The axes as motor records, by their names.
        report: Gets the text of each refusal.
    """

    def __init__(
        self,
        mirror: StageMirror,
        mover: StageMover,
        names: Names,
        records: Records,
        motors: Mapping[str, AxisMotor],
        report: Callable[[str], None],
    ) -> None:
        self._mirror, self._mover, self._names, self._records = mirror, mover, names, records
        self._motors, self._report = motors, report
        self._actions = Actions(mover, names, records)
        self._loop = asyncio.get_running_loop()

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
        if why := _FIELDS[field].why_not(value):
            return self._is_fine(axis, field, why)
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
                return self._is_fine(axis, "VELO", motor.take_speed(value))
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
            speeds = {axis: motor.speed_um_per_s}
            try:
                answers = await self._mover.goto({axis: position_um}, speeds)
            except NotReachedError:  # a stop came first, and ends it
                motor.dropped()
                return
            motor.accepted(position_um, answers[axis])
        if refused:
            motor.rejected()

    async def _stop(self, axis: str) -> None:
        """Stop the stage, which resumes at the present position, so that it can move again."""
        with self._reported(f"{axis}.STOP"), ExitStack() as stopping:
            for name, motor in self._motors.items():
                stopping.enter_context(motor.stopping(asked=name == axis))
            await self._mover.stop(self._mirror.state, resume=True)

    def refuse(self, full: str, why: str) -> None:
        """Report that a write was refused; from any thread."""
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
