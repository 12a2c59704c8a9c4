"""Signals of ophyd-async whose values are those of a stage."""

import asyncio
import math
import time
from collections.abc import Awaitable, Callable
from typing import Any, Final, Generic, NamedTuple, TypeVar

from bluesky.protocols import Reading
from event_model import DataKey
from ophyd_async.core import (
    Callback,
    SignalBackend,
    SignalMetadata,
    SignalR,
    SignalRW,
    SoftSignalBackend,
    make_datakey,
)

from piezod.bluesky.connected_stage import ConnectedStage
from piezod.config.states import State
from piezod.errors import ClientError
from piezod.messages.answers import Status
from piezod.messages.telemetry import Telemetry

_UNKNOWN, _OK, _MINOR, _MAJOR = -1, 0, 1, 2
"""Severities of a reading."""
_DOWN: Final = (State.BLIND, State.FAULT, State.ESTOP)

ValueT = TypeVar("ValueT", bound=float | str)


class SignalSource(NamedTuple, Generic[ValueT]):
    """How to read a value."""

    path: str  #: Path below the stage, for example "x/position_um".
    datatype: type[ValueT]  #: Type of the value.
    #: Returns the value in a status; None if it is unknown.
    of_status: Callable[[Status], ValueT | None]
    #: Returns the value in an interval of telemetry; None if it is unknown.
    of_interval: Callable[[Telemetry], ValueT | None]
    metadata: Callable[[], SignalMetadata] = SignalMetadata  #: Returns unit, precision and limits.


class StageBackend(SignalBackend[ValueT]):
    """Reads a value by a request, or by telemetry while it is monitored.

    Args:
        link: Connection to the stage.
        source: How to read the value.
        move: Moves to a value and waits for the arrival; None for a value that cannot be set.
    """

    def __init__(
        self,
        link: ConnectedStage,
        source: SignalSource[ValueT],
        move: Callable[[ValueT], Awaitable[None]] | None = None,
    ) -> None:
        super().__init__(source.datatype)
        self._link, self._source, self._move = link, source, move
        self._monitor: asyncio.Task[None] | None = None

    def source(self, name: str, read: bool) -> str:  # noqa: ARG002 - the interface has them
        """Return the source for the descriptor."""
        return f"piezod://{self._link.title}/{self._source.path}"

    async def connect(self, timeout: float) -> None:
        """Do nothing: the stage connects."""

    async def put(self, value: ValueT | None) -> None:
        """Move to a value; return on arrival.

        Raises:
            NotImplementedError: If the value cannot be set.
            ClientError: If the stage does not arrive.
        """
        if self._move is None or value is None:
            raise NotImplementedError(f"{self._source.path} cannot be set")
        await self._move(value)

    async def get_datakey(self, source: str) -> DataKey:
        """Return the description of the value."""
        metadata = self._source.metadata()
        return make_datakey(self._source.datatype, self._source.datatype(), source, metadata)

    async def get_reading(self) -> Reading[ValueT]:
        """Return the value, requested now."""
        status = await self._link.mirror.status()
        return self._reading(
            self._source.of_status(status), status.state, [fault.id for fault in status.faults]
        )

    async def get_value(self) -> ValueT:
        """Return the value, requested now."""
        return (await self.get_reading())["value"]

    async def get_setpoint(self) -> ValueT:
        """Return the value, requested now."""
        return await self.get_value()

    def set_callback(self, callback: Callback[Reading[ValueT]] | None) -> None:
        """Call a function with each new value, until this is called with None."""
        if self._monitor is not None:
            self._monitor.cancel()
        self._monitor = None if callback is None else asyncio.create_task(self._watch(callback))

    async def _watch(self, callback: Callback[Reading[ValueT]]) -> None:
        async for each in self._link.mirror.following():
            if isinstance(each, ClientError):
                unknown = self._reading(None, "", [])
                callback({**unknown, "alarm_severity": _UNKNOWN, "message": str(each)})
            else:
                value = self._source.of_interval(each)
                callback(self._reading(value, each.state, list(each.faults)))

    def _reading(self, value: ValueT | None, state: str, faults: list[str]) -> Reading[Any]:
        unknown = "" if self._source.datatype is str else math.nan
        severity = _MAJOR if state in _DOWN else _MINOR if faults else _OK
        return Reading(
            value=unknown if value is None else value,
            timestamp=time.time(),
            alarm_severity=severity,
            message=", ".join(faults),
        )


def readable(link: ConnectedStage, source: SignalSource[ValueT]) -> SignalR[ValueT]:
    """Return a signal that can be read and monitored."""
    return SignalR(StageBackend(link, source))


def configured() -> tuple[SignalR[float], Callable[[float, SignalMetadata], None]]:
    """Return a signal with a number of the configuration in force, and what sets it."""
    backend = SoftSignalBackend(float)

    def put(value: float, metadata: SignalMetadata) -> None:
        backend.metadata = metadata
        backend.set_value(value)

    return SignalR(backend), put


def movable(
    link: ConnectedStage, source: SignalSource[float], move: Callable[[float], Awaitable[None]]
) -> SignalRW[float]:
    """Return a signal that moves the stage; to set it is to wait for the arrival."""
    return SignalRW(StageBackend(link, source, move), timeout=None)
