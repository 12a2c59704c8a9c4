"""What a client does to a stage: its movements, its lease, and what a stop means for them.

A stop means the same in all adapters. The voltage is held at once, before everything that waits.
Movements of this client that wait for their turn are dropped. One that is on its way to the daemon
ends too: the daemon either holds it, or refuses it in HOLD, because nothing resumes before it is
answered. A motor of EPICS or GCS then resumes at the present position; a device of Bluesky does so
at its next movement. Nobody resumes a stage that somebody else, or a fault, has held before.
"""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Final

from piezod.client.arrival import LEASE_HELD
from piezod.client.daemon_link import DaemonLink
from piezod.config.states import State
from piezod.errors import ClientError, NotReachedError, RefusedError
from piezod.messages.answers import Answer

RENEW_EACH_S: Final = 10.0
"""Time between two renewals of a lease that is kept, in s; it expires after 30 s."""
_NOTHING_DRIVEN: Final = "refused"
"""Code of the daemon's answer to `hold` if nothing is driven, and to `resume` if it cannot."""
_MAYBE_RUNNING: Final = (State.RUN, "")


class StageMover:
    """The movements and the lease of one client.

    Args:
        link: Its connection to the daemon.

    Attributes:
        lost: Who has the lease that shall be kept here, if it was lost meanwhile.
    """

    def __init__(self, link: DaemonLink) -> None:
        self.link = link
        self._sending = asyncio.Lock()
        self._stops, self._held_here = 0, False
        self._leasing = asyncio.Lock()
        self._renewal: asyncio.Task[None] | None = None
        self.lost: RefusedError | None = None
        self._keepers: set[object] = set()

    # ------------------------------------------------------------------ movements

    async def goto(
        self, targets_um: Mapping[str, float], speeds_um_per_s: Mapping[str, float] | None = None
    ) -> dict[str, Answer]:
        """Move axes, one after the other; return the answers by the names of the axes.

        Args:
            targets_um: Targets in µm, by the names of the axes.
            speeds_um_per_s: Speeds in µm/s; the configured ones where there is none.

        Raises:
            NotReachedError: If a stop came before all of them had begun; the code is "stopped".
            ClientError: If the daemon refuses.
        """
        stops, speeds, answers = self._stops, speeds_um_per_s or {}, {}
        for axis, um in targets_um.items():
            async with self._sending:
                if self._stops != stops:
                    raise _stopped(axis)
                try:
                    speed = speeds.get(axis)
                    answers[axis] = await self.link.goto(um, axis=axis, speed_um_per_s=speed)
                except RefusedError as error:
                    if self._stops == stops:
                        raise
                    raise _stopped(axis) from error
        return answers

    async def stop(self, state: str, *, resume: bool) -> bool:
        """Hold the voltage of all axes at once; return whether they were driven.

        Args:
            state: Newest known state of the stage; empty if it is unknown.
            resume: Whether a stage in RUN resumes now at its present position, so that it follows
                the next movement, unless another stop has come; one that cannot stays in HOLD.
                Otherwise `go_on` resumes it.

        Raises:
            ClientError: If the daemon does not answer, or does not allow it.
        """
        self._stops = this = self._stops + 1
        hold = asyncio.create_task(self._hold())  # at once, also beside a movement
        async with self._sending:
            if not await asyncio.shield(hold):
                return False
            if not resume:
                self._held_here = self._held_here or state != State.HOLD
            elif state in _MAYBE_RUNNING and self._stops == this:
                await self._resume()
        return True

    async def go_on(self) -> None:
        """Resume if a stop of this client has held the stage, and it is still held.

        Raises:
            ClientError: If the daemon does not answer, or refuses to resume.
        """
        async with self._sending:
            if self._held_here and (await self.link.status()).state == State.HOLD:
                await self.link.resume()
            self._held_here = False

    async def _hold(self) -> bool:
        """Hold; return whether anything was driven."""
        try:
            await self.link.hold()
        except RefusedError as error:
            if error.code != _NOTHING_DRIVEN:
                raise
            return False
        return True

    async def _resume(self) -> None:
        try:
            await self.link.resume()
        except RefusedError as error:
            if error.code != _NOTHING_DRIVEN:
                raise

    # ------------------------------------------------------------------ the lease

    @asynccontextmanager
    async def commanding(self) -> AsyncIterator[None]:
        """Return a context manager in which this client has the lease.

        Raises:
            RefusedError: If another client has it.
            ClientError: If the daemon does not answer.
        """
        keeper = object()
        await self.take_lease(keeper)
        try:
            yield
        finally:
            await self.return_lease(keeper)

    async def take_lease(self, keeper: object) -> None:
        """Take the lease, and renew it until each keeper has returned it.

        Raises:
            RefusedError: If another client has it.
            ClientError: If the daemon does not answer.
        """
        async with self._leasing:
            if not self._keepers - {keeper}:
                await self.link.renew_lease()
            self._keepers.add(keeper)
            if self._renewal is None:
                self._renewal = asyncio.create_task(self._renew())

    async def return_lease(self, keeper: object) -> None:
        """Release the lease if nobody else in this process keeps it. Never raises."""
        async with self._leasing:
            self._keepers.discard(keeper)
            if self._keepers:
                return
            if self._renewal is not None:
                self._renewal.cancel()
                self._renewal = None
            with suppress(ClientError):  # then the daemon has ended, or it ends within 30 s
                await self.link.release_lease()

    async def close(self, *, release: bool = True) -> None:
        """Close the connection; movements that wait are dropped.

        Args:
            release: Whether to release the lease; otherwise it expires.
        """
        self._stops += 1
        self._keepers.clear()
        if self._renewal is not None:
            self._renewal.cancel()
        async with self._sending:
            await self.link.close(release=release)

    async def _renew(self) -> None:
        while True:
            await asyncio.sleep(RENEW_EACH_S)
            try:
                await self.link.renew_lease()
                self.lost = None
            except ClientError as error:  # the next command reports it
                if isinstance(error, RefusedError) and error.code == LEASE_HELD:
                    self.lost = error


def _stopped(axis: str) -> NotReachedError:
    return NotReachedError(f"axis {axis}: stopped before it began", code="stopped")
