"""A stage as it is seen by a program between its daemon and other clients: page, IOC, GCS, Bluesky.

Whether the daemon answers, what the status is, what the limits are, what the telemetry says, and
when a movement is done is decided here for all of them. `mover` has what they do to the stage.
"""

import asyncio
import time
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import aclosing, asynccontextmanager, suppress
from typing import Any, Final, TypeAlias

from piezod.client import AsyncStageClient
from piezod.client.arrival import Arrival, Arriving, StartedMove
from piezod.client.daemon_link import DaemonLink
from piezod.client.errors import unexpected
from piezod.client.facts import AxisFacts, facts_in
from piezod.errors import ClientError
from piezod.messages.answers import Status
from piezod.messages.telemetry import Telemetry

SILENT_S: Final = 3.0
"""A daemon that sends no telemetry for this time does not answer, in s."""
AGAIN_S: Final = 0.3
"""Time until telemetry that has ended is opened again, in s."""
STATUS_EACH_S: Final = 1.0
"""Time between two requests of the status of a stage that somebody looks at, in s."""
AT_MOST_EACH_S: Final = 0.2
"""Shortest time between two of them: near its tolerance a stage changes in every interval."""
_GATHER_S: Final = 0.001
"""Those who ask for the status within this time share a request."""

_Queue: TypeAlias = "asyncio.Queue[Telemetry | ClientError]"


class StageMirror:
    """A running stage, for several who look at it. Nothing is asked while nobody does.

    Args:
        link: Connection to the daemon, which outlives it.
        rate_hz: Rate of the telemetry, in Hz, 1 to 50.

    Attributes:
        link: The connection.
        state: State in the newest status or interval; empty if it is unknown, or if a command has
            changed it since.
    """

    def __init__(self, link: DaemonLink, rate_hz: float = 50.0) -> None:
        self.link, self._rate_hz = link, rate_hz
        self.state = ""
        self._status: Status | None = None
        self._asking: asyncio.Future[Status] | None = None
        self._requests: set[asyncio.Future[Status]] = set()
        self._status_s = self._facts_s = self._expired_s = float("-inf")
        self._facts: dict[str, AxisFacts] = {}
        self._queues: set[_Queue] = set()
        self._reading: asyncio.Task[None] | None = None
        self._changed = asyncio.Event()
        self._steady: tuple[object, ...] = ()

    # ------------------------------------------------------------------ status and limits

    async def status(self, max_age_s: float = 0.0) -> Status:
        """Return the status; those who ask together share it, so that it is of one cycle.

        Args:
            max_age_s: Longest time since it was requested, in s; it is newer than the last command
                in any case.

        Raises:
            ClientError: If the daemon does not answer.
        """
        if self._status is not None and time.monotonic() - self._status_s <= max_age_s:
            return self._status
        if self._asking is None:
            self._asking = asyncio.ensure_future(self._ask())
            self._requests.add(self._asking)
            self._asking.add_done_callback(self._requests.discard)
            self._asking.add_done_callback(take_exception)
        return await asyncio.shield(self._asking)

    async def facts(self, max_age_s: float = 0.0) -> dict[str, AxisFacts]:
        """Return what the configuration in force says about each axis; a reload may change it.

        Raises:
            ClientError: If the daemon does not answer.
        """
        if time.monotonic() - self._facts_s > max_age_s:
            asked_s = time.monotonic()
            self._facts = facts_in(await self.link.config())
            self._facts_s = asked_s
        return self._facts

    def expire(self) -> None:
        """Do not use the present status again: a command has changed it."""
        self._status, self.state, self._expired_s = None, "", time.monotonic()

    async def close(self) -> None:
        """End the requests whose askers have been cancelled."""
        for request in self._requests:
            request.cancel()
        await asyncio.gather(*self._requests, return_exceptions=True)

    async def _ask(self) -> Status:
        await asyncio.sleep(_GATHER_S)
        self._asking, asked_s = None, time.monotonic()
        status = await self.link.status()
        if asked_s > self._expired_s:
            self._status, self._status_s, self.state = status, asked_s, status.state
        return status

    # ------------------------------------------------------------------ telemetry

    @asynccontextmanager
    async def listening(self) -> AsyncIterator[AsyncIterator[Telemetry]]:
        """Return a context manager that gives the intervals from now on.

        All listeners share one stream. The iterator raises ClientError if the daemon ends, falls
        silent or refuses.
        """
        queue: _Queue = asyncio.Queue()
        self._queues.add(queue)
        if self._reading is None:
            self._reading = asyncio.create_task(self._read())
        try:
            yield _intervals(queue)
        finally:
            self._queues.discard(queue)
            if not self._queues and self._reading is not None:
                reading, self._reading = self._reading, None
                reading.cancel()
                await asyncio.wait({reading})

    async def following(self) -> AsyncGenerator[Telemetry | ClientError, None]:
        """Yield each interval, for ever; without telemetry, the reason, until there is some."""
        while True:
            try:
                async with self.listening() as intervals:
                    async for interval in intervals:
                        yield interval
            except ClientError as error:
                yield error
            await asyncio.sleep(AGAIN_S)

    async def arrivals(
        self, move: StartedMove, timeout_s: float | None = None
    ) -> AsyncGenerator[tuple[Arrival, ...], None]:
        """Yield after each interval where the axes have arrived, empty while the movement goes on.

        It goes on after that, because the stage may be stopped then.

        Args:
            move: A movement of this stage.
            timeout_s: As for `Arriving`.

        Raises:
            NotReachedError: If the movement was interrupted, or takes too long.
            ClientError: If the daemon does not answer, or ends.
        """
        facts = await self.facts(STATUS_EACH_S)
        blind = [axis for axis, known in facts.items() if not known.has_sensor]
        arriving = Arriving(move, timeout_s, blind=blind)
        async with self.listening() as intervals:
            async for interval in intervals:
                yield arriving.feed(interval)

    async def arrived(self, move: StartedMove, timeout_s: float | None = None) -> None:
        """Return when a movement is done; arguments and errors as for `arrivals`."""
        async with aclosing(self.arrivals(move, timeout_s)) as found:
            async for arrivals in found:
                if arrivals:
                    return

    async def until_changed(self, longest_s: float = STATUS_EACH_S) -> None:
        """Wait until the telemetry shows another state than before, at most some time in s."""
        await asyncio.sleep(AT_MOST_EACH_S)
        with suppress(TimeoutError):
            async with asyncio.timeout(longest_s):
                await self._changed.wait()
        self._changed.clear()

    def look_again(self) -> None:
        """Let `until_changed` end now."""
        self._changed.set()

    async def _read(self) -> None:
        this = asyncio.current_task()
        try:
            async with (
                AsyncStageClient(socket=self.link.socket, name=self.link.name) as client,
                aclosing(client.telemetry(self._rate_hz)) as intervals,
            ):
                while True:
                    async with asyncio.timeout(SILENT_S):
                        interval = await anext(intervals)
                    self._note(interval)
                    self._hand_out(interval)
        except TimeoutError:
            what = f"{self.link.socket}: the daemon sends no telemetry for {SILENT_S:g} s"
            self._hand_out(ClientError(what, "look at the log of the daemon", "no_answer"))
        except ClientError as error:
            self._hand_out(error)
        except Exception as error:  # noqa: BLE001 - a daemon of another version; nobody may wait
            self._hand_out(unexpected({}, repr(error)))
        finally:
            self._facts_s = float("-inf")  # a daemon that starts again may have other limits
            if self._reading is this:
                self._reading = None

    def _note(self, interval: Telemetry) -> None:
        self.state = interval.state
        if (now := steady(interval)) != self._steady:
            self._steady = now
            self._changed.set()

    def _hand_out(self, item: Telemetry | ClientError) -> None:
        for queue in self._queues:
            queue.put_nowait(item)


def steady(interval: Telemetry) -> tuple[object, ...]:
    """Return what in an interval changes with an event only, and not with each sample."""
    axes = [(axis.mode, axis.motion, axis.on_target) for axis in interval.axes.values()]
    return interval.state, interval.shadow, interval.faults, axes


def take_exception(future: "asyncio.Future[Any]") -> None:
    """Take the exception of a request that nobody waits for any more."""
    if not future.cancelled():
        future.exception()


async def _intervals(queue: _Queue) -> AsyncIterator[Telemetry]:
    while True:
        item = await queue.get()
        if isinstance(item, ClientError):
            raise item
        yield item
