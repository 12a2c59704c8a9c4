"""Movements, and the wait for their end."""

from asyncio import Event
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf

from piezod.bluesky.connected_stage import ConnectedStage
from piezod.client.arrival import StartedMove
from piezod.client.calls import Waveforms
from piezod.errors import RefusedError


async def move_to(
    link: ConnectedStage, axis: str, position_um: float, *, limited: bool = True
) -> None:
    """Move an axis; return when it is on target.

    An axis without a sensor has arrived when its command has.

    Args:
        link: Connection to the stage.
        axis: Name of the axis.
        position_um: Target, in µm.
        limited: Whether to wait no longer than the movement takes, and some time to settle.

    Raises:
        NotReachedError: If the movement ends before its target, or takes too long.
        ClientError: If the daemon refuses it, or ends.
    """
    async with link.commanding():
        with moving(link, axis):
            await link.mover.go_on()
            answer = (await link.mover.goto({axis: position_um}))[axis]
            move = StartedMove(answer, (axis,))
            await link.mirror.arrived(move, None if limited else inf)


async def follow_waves(
    link: ConnectedStage, command_um: Waveforms, duration_s: float, begun: Event
) -> None:
    """Follow waveforms; return when the movement is done.

    Args:
        link: Connection to the stage.
        command_um: Axis: position over time in µm.
        duration_s: Duration of the waveforms, in s.
        begun: Set when the daemon has accepted them.

    Raises:
        NotReachedError: If the stage was stopped, held, or moved by another client.
        ClientError: If the daemon refuses them, or ends.
    """
    with moving(link, *command_um):
        await link.mover.go_on()
        answer = await link.daemon.wave(command_um, duration_s)
        begun.set()
        await link.mirror.arrived(StartedMove(answer, tuple(command_um), follows_waves=True))


@contextmanager
def moving(link: ConnectedStage, *axes: str) -> Iterator[None]:
    """Note that axes move, until they have arrived or somebody else has ended the movement.

    After a time-out or an interruption they still move, as far as this process knows.
    """
    link.moving.update(axes)
    try:
        yield
    except (
        RefusedError
    ):  # or a NotReachedError: the stage does not move, or another client moves it
        link.moving.difference_update(axes)
        raise
    link.moving.difference_update(axes)
