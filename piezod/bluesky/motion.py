"""Movements, and the wait for their end."""

from asyncio import Event
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from math import inf
from typing import Final

from piezod.bluesky.connected_stage import ConnectedStage
from piezod.client.arrival import Arriving, arrival
from piezod.client.calls import Waveforms
from piezod.errors import RefusedError
from piezod.messages.answers import Answer
from piezod.messages.telemetry import Telemetry

_SETTLE_S: Final = 1.0
"""Time after the end of waveforms for the axes to settle, in s."""


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
    async with link.commanding(), link.mirror.listening() as intervals:
        with moving(link, axis):
            await link.mover.go_on()
            answer = (await link.mover.goto({axis: position_um}))[axis]
            has_sensor = link.facts[axis].has_sensor
            arriving = Arriving(answer, axis, None if limited else inf, has_sensor=has_sensor)
            async for interval in intervals:
                if arriving.feed(interval):
                    return


async def follow_waves(
    link: ConnectedStage, command_um: Waveforms, duration_s: float, begun: Event
) -> None:
    """Follow waveforms; return when they have ended and all axes are on target.

    If an axis does not come within its tolerance, the end is `_SETTLE_S` after the waveforms.

    Args:
        link: Connection to the stage.
        command_um: Axis: position over time in µm.
        duration_s: Duration of the waveforms, in s.
        begun: Set when the daemon has accepted them.

    Raises:
        NotReachedError: If the stage was stopped, held, or moved by another client.
        ClientError: If the daemon refuses them, or ends.
    """
    async with link.mirror.listening() as intervals:
        with moving(link, *command_um):
            await link.mover.go_on()
            answer = await link.daemon.wave(command_um, duration_s)
            begun.set()
            await _waves_end(intervals, answer, tuple(command_um))


async def _waves_end(
    intervals: AsyncIterator[Telemetry], answer: Answer, axes: tuple[str, ...]
) -> None:
    begin_s = inf
    async for interval in intervals:
        arrival(interval, answer.motion, axes[0])  # raises if the movement was interrupted
        if interval.axes[axes[0]].motion < answer.motion:
            continue
        begin_s = min(begin_s, interval.t_s)
        if all(interval.axes[axis].on_target for axis in axes):
            return
        if interval.t_s - begin_s > answer.duration_s + _SETTLE_S:
            return


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
