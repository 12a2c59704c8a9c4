"""The dialogue with one client: commands in, replies out, and the last error."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

from piezod.client.mirror import take_exception
from piezod.client.mover import StageMover
from piezod.errors import ClientError
from piezod.gcs import queries
from piezod.gcs.errors import Code, GcsRefusal, refusal_of
from piezod.gcs.motion import MotionCommands
from piezod.gcs.readings import UP, Readings
from piezod.gcs.syntax import (
    ENCODING,
    IS_MOVING,
    IS_READY,
    LONGEST,
    STOP_ALL,
    LineBuffer,
    ids_in,
    lines,
)

READY: Final = "\xb1\n"
BUSY: Final = "\xb0\n"

_HTTP: Final = ("GET", "HEAD", "POST", "OPTIONS")
"""First words of what a browser sends; no command of GCS has such a name."""
_TLS: Final = b"\x16\x03"
"""A browser begins an encrypted connection with these bytes, and random ones, which may stop."""

_STOPS: Final = (STOP_ALL, "STP", "HLT")
_MOST_WAITING: Final = 4096
"""Commands of a client that wait for their turn; more close the connection."""

Handler = Callable[[str], Awaitable[str | None]]
"""Carries out a command with its arguments; returns the reply, None for none."""


class GcsSession:
    """One connection: it has a lease of its own, and an error of its own.

    Commands are carried out one after the other, in their order. A stop is carried out when it
    arrives, and drops the movements before it that have not begun; its error comes in its order.

    Args:
        mover: Moves and stops for it.
        readings: Status and limits of the stage, shared by all connections.
        mode: The mode that `SVO 1` selects.
        identity: Reply to `*IDN?`, without line feed.
        report: Gets the text of each refusal, because the protocol has only its number.
        send: Sends a reply; returns when the client takes it.
    """

    def __init__(
        self,
        mover: StageMover,
        readings: Readings,
        mode: str,
        identity: str,
        report: Callable[[str], None],
        send: Callable[[bytes], Awaitable[None]],
    ) -> None:
        self._mover, self._readings, self._identity = mover, readings, identity
        self._report, self._buffer, self._error = report, LineBuffer(), Code.NONE
        self._send = send
        self.waiting: asyncio.Queue[tuple[str, int, asyncio.Task[None] | None]] = asyncio.Queue()
        """Commands, the number of stops before them, and a stop that is carried out already."""
        self._stops = 0
        self._stopping: set[asyncio.Task[None]] = set()
        self._motion = motion = MotionCommands(mover, readings, mode)
        self._handlers: dict[str, tuple[Handler, str]] = {
            IS_MOVING: (self._is_moving, "motion status of the axes, a bit mask"),
            IS_READY: (self._is_ready, "whether the stage is ready"),
            STOP_ALL: (motion.stop, "stop all axes"),
            "*IDN?": (self._identify, "identity"),
            "CSV?": (self._version, "version of the syntax"),
            "ERR?": (self._take_error, "last error"),
            "HLP?": (self._help, "list of commands"),
            "HLT": (motion.stop, "stop all axes"),
            "FRF": (motion.reference, "nothing: every axis is referenced"),
            "MOV": (motion.move, "{<axis> <position>}: move"),
            "MVR": (motion.move_relative, "{<axis> <distance>}: move relative to the target"),
            "ONL": (self._accept, "nothing: the amplifier is online"),
            "ONL?": (self._axis_query(queries.yes), "[{<axis>}]: online"),
            "SAI?": (self._axes, "identifiers of the axes"),
            "SPA?": (self._parameter, "<axis> <parameter>: unit or limit"),
            "SRG?": (self._register, "<axis> 1: status register"),
            "STP": (motion.stop, "stop all axes"),
            "SVO": (motion.set_servo, "{<axis> <0|1>}: switch the servo"),
            "TPC?": (self._count, "number of axes"),
            "VEL": (motion.set_speed, "{<axis> <speed>}: set the speed"),
            "VEL?": (self._axis_query(motion.speed), "[{<axis>}]: speed"),
            **{
                name: (self._axis_query(value), f"[{{<axis>}}]: {text}")
                for name, (value, text) in queries.AXIS_QUERIES.items()
            },
        }

    def take(self, data: bytes) -> None:
        """Take the commands that these bytes complete, for `work`; carry a stop out at once.

        Raises:
            ConnectionAbortedError: If a browser sends them, because a web page must not move a
                stage; or if too many wait.
        """
        if data.startswith(_TLS):
            raise ConnectionAbortedError("this port serves GCS, not TLS")
        for command in self._buffer.feed(data):
            name, arguments = _parts(command)
            if name in _HTTP:
                raise ConnectionAbortedError("this port serves GCS, not HTTP")
            if self.waiting.qsize() >= _MOST_WAITING:
                raise ConnectionAbortedError(f"{_MOST_WAITING} commands wait for their turn")
            stop = None
            if name in _STOPS and len(command) <= LONGEST:
                self._stops += 1
                stop = asyncio.create_task(self._motion.stop(arguments))
                self._stopping.add(stop)
                stop.add_done_callback(self._stopping.discard)
                stop.add_done_callback(take_exception)
            self.waiting.put_nowait((command, self._stops, stop))

    async def work(self) -> None:
        """Carry out the commands in their order, until the task is cancelled."""
        while True:
            line, stops, stop = await self.waiting.get()
            if stop is not None or stops == self._stops or not _may_move(line):
                reply = await self._carry_out(line, stop)
                await self._send(reply.encode(ENCODING, "replace"))
            self.waiting.task_done()

    async def close(self) -> None:
        """Release the lease; the stage continues, and a stop is carried out to its end."""
        if self._stopping:
            await asyncio.wait(self._stopping)
        await self._mover.close()

    async def _carry_out(self, line: str, stop: asyncio.Task[None] | None) -> str:
        name, arguments = _parts(line)
        if not name:
            return ""
        try:
            if stop is not None:
                await asyncio.shield(stop)
            handler, _ = self._handlers.get(name, (_unknown, ""))
            if len(line) > LONGEST:
                handler = _too_long
            return await handler(arguments) or ""
        except GcsRefusal as refusal:
            self._refuse(line, refusal)
        except ClientError as error:
            self._refuse(line, refusal_of(error))
        return BUSY if name == IS_READY else ""

    def _refuse(self, line: str, refusal: GcsRefusal) -> None:
        self._error = refusal.code
        if refusal.code is not Code.STOPPED:
            self._report(f"{line.strip()[:64]}: error {refusal.code.value}: {refusal.why}")

    def _axis_query(self, value: queries.AxisValue) -> Handler:
        async def answer(arguments: str) -> str:
            axes = await self._readings.axes()
            return lines([f"{id_}={value(axes[id_])}" for id_ in ids_in(arguments, tuple(axes))])

        return answer

    async def _is_moving(self, _arguments: str) -> str:
        return lines([queries.is_moving(await self._readings.axes())])

    async def _is_ready(self, _arguments: str) -> str:
        return READY if await self._readings.state() in UP else BUSY

    async def _identify(self, _arguments: str) -> str:
        return lines([self._identity])

    async def _version(self, _arguments: str) -> str:
        return lines(["2.0"])

    async def _take_error(self, _arguments: str) -> str:
        error, self._error = self._error, Code.NONE
        return lines([str(error.value)])

    async def _help(self, _arguments: str) -> str:
        # Clients drop the first and the last line, and read the first word of each other line.
        texts = [f"{name} {text}" for name, (_, text) in self._handlers.items()]
        return lines(["The following commands are valid:", *texts, "end of help"])

    async def _accept(self, _arguments: str) -> None:
        """Do nothing: the daemon alone decides about the amplifier."""

    async def _axes(self, _arguments: str) -> str:
        return lines(list(await self._readings.axes()))

    async def _count(self, _arguments: str) -> str:
        return lines([str(len(await self._readings.axes()))])

    async def _parameter(self, arguments: str) -> str:
        return lines([queries.parameter(await self._readings.axes(), arguments)])

    async def _register(self, arguments: str) -> str:
        return lines([queries.register(await self._readings.axes(), arguments)])


def _parts(line: str) -> tuple[str, str]:
    """Return the name of a command, and its arguments."""
    name, _, arguments = line.strip().partition(" ")
    return name.upper(), arguments.strip()


def _may_move(line: str) -> bool:
    """Return whether a command moves the stage, or arms it, which may condition it."""
    name, arguments = _parts(line)
    return name in {"MOV", "MVR"} or (name == "SVO" and "1" in arguments.split()[1::2])


async def _unknown(_arguments: str) -> None:
    raise GcsRefusal(Code.UNKNOWN_COMMAND, "unknown command")


async def _too_long(_arguments: str) -> None:
    raise GcsRefusal(Code.TOO_LONG, f"the line is longer than {LONGEST} bytes")
