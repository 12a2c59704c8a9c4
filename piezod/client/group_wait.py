"""The wait until stages that move together have arrived, each seen in a mirror of its own."""

import asyncio
import threading
from collections.abc import Coroutine, Mapping
from contextlib import aclosing
from typing import Any, Final, TypeAlias, TypeVar

from piezod.client.arrival import Arrival, StartedMove
from piezod.client.daemon_link import DaemonLink
from piezod.client.mirror import StageMirror
from piezod.client.mover import StageMover
from piezod.client.parallel import Outcomes
from piezod.client.places import find_socket
from piezod.client.wire import WAITING_RATE_HZ
from piezod.errors import ClientError

ResultT = TypeVar("ResultT")
Moves: TypeAlias = Mapping[str, StartedMove]
"""The movement of each stage, by its name."""
_CLEANING_UP_S: Final = 5.0


def wait_for(moves: Moves, client: str, timeout_s: float | None) -> Outcomes[tuple[Arrival, ...]]:
    """Wait until all stages have arrived, or until one of them cannot any more.

    Their leases are kept meanwhile. A stage that has arrived is watched until the last one has.

    Args:
        moves: The movements.
        client: Name of the client that has the leases.
        timeout_s: As for `Arriving`.
    """
    return _in_thread(_GroupWait(moves, client, timeout_s).run())


class _GroupWait:
    def __init__(self, moves: Moves, client: str, timeout_s: float | None) -> None:
        self._moves, self._client, self._timeout_s = moves, client, timeout_s
        self._arrived: dict[str, tuple[Arrival, ...]] = {}

    async def run(self) -> Outcomes[tuple[Arrival, ...]]:
        watches = {stage: asyncio.create_task(self._watch(stage)) for stage in self._moves}
        try:
            await asyncio.wait(watches.values(), return_when=asyncio.FIRST_EXCEPTION)
        finally:
            for each in watches.values():
                each.cancel()
            ended = await asyncio.gather(*watches.values(), return_exceptions=True)
        if self._all_there:
            return Outcomes(done={stage: self._arrived[stage] for stage in self._moves})
        found = Outcomes[tuple[Arrival, ...]]()
        for stage, error in zip(watches, ended, strict=True):
            if isinstance(error, ClientError):
                found.failed[stage] = error
            elif isinstance(error, Exception):
                raise error
        return found

    @property
    def _all_there(self) -> bool:
        return len(self._arrived) == len(self._moves)

    async def _watch(self, stage: str) -> None:
        link = DaemonLink(find_socket(stage), self._client)
        mirror, mover = StageMirror(link, WAITING_RATE_HZ), StageMover(link)
        try:
            await mover.take_lease(self)
            async with aclosing(mirror.arrivals(self._moves[stage], self._timeout_s)) as found:
                async for arrivals in found:
                    if mover.lost:
                        raise mover.lost
                    if arrivals:
                        self._arrived[stage] = arrivals
                    if self._all_there:
                        return
        finally:
            await mirror.close()
            await mover.close(release=False)


def _in_thread(coroutine: Coroutine[Any, Any, ResultT]) -> ResultT:
    """Return the result of a coroutine; in a thread, because a notebook has a loop in this one."""
    loop = asyncio.new_event_loop()
    task = loop.create_task(coroutine)

    def run() -> None:
        try:
            loop.run_until_complete(asyncio.wait({task}))
        finally:
            loop.close()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        thread.join()
    except BaseException:  # the user interrupts it
        loop.call_soon_threadsafe(task.cancel)
        thread.join(_CLEANING_UP_S)
        raise
    return task.result()
