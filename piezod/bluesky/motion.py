"""Movements, and the wait for their end."""

import asyncio
import math
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from typing import Final

from piezod.bluesky.link import StageLink
from piezod.client.arrival import SAME_UM, arrival
from piezod.client.calls import Waveforms
from piezod.errors import NotReachedError, RefusedError
from piezod.messages.telemetry import Telemetry

_SETTLE_S: Final = 1.0
"""Time after the end of waveforms for the axes to settle, in s."""
_SILENT_S: Final = 20.0
"""Longest time without telemetry, or of a lead-in, in s."""


async def move_to(link: StageLink, axis: str, position_um: float) -> None:
    """Move an axis; return when it is on target.

    An axis without a sensor has arrived when its command has.

    Args:
        link: Connection to the stage.
        axis: Name of the axis.
        position_um: Target, in µm.

    Raises:
        NotReachedError: If the movement ends before its target.
        ClientError: If the daemon refuses it, or ends.
    """
    async with link.commanding(), link.hub.listening() as intervals:
        with moving(link, axis):
            await link.go_on()
            answer = await link.daemon.goto(position_um, axis=axis)
            await on_target(intervals, axis, answer.motion, link.facts[axis].has_sensor)


async def follow_waves(
    link: StageLink, command_um: Waveforms, duration_s: float, begun: asyncio.Event
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
    try:
        async with asyncio.timeout(duration_s + _SILENT_S), link.hub.listening() as intervals:
            with moving(link, *command_um):
                await link.go_on()
                motion = (await link.daemon.wave(command_um, duration_s)).motion
                begun.set()
                await _waves_end(intervals, motion, tuple(command_um), duration_s)
    except TimeoutError as error:
        what = f"{link.title}: the waveforms of {duration_s:g} s have not ended in time"
        raise NotReachedError(what, "look at the log of the daemon", "timeout") from error


async def _waves_end(
    intervals: AsyncIterator[Telemetry], motion: int, axes: tuple[str, ...], duration_s: float
) -> None:
    begin_s = math.inf
    async for interval in intervals:
        arrival(interval, motion, axes[0])  # raises if the movement was interrupted
        if interval.axes[axes[0]].motion < motion:
            continue
        begin_s = min(begin_s, interval.t_s)
        if all(interval.axes[axis].on_target for axis in axes):
            return
        if interval.t_s - begin_s > duration_s + _SETTLE_S:
            return


@contextmanager
def moving(link: StageLink, *axes: str) -> Iterator[None]:
    """Note that axes move, until they have arrived or somebody else has ended the movement.

    After a time-out or an interruption they still move.

    Args:
        link: Connection to the stage.
        axes: Names of the axes.
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


async def on_target(
    intervals: AsyncIterator[Telemetry], axis: str, motion: int, has_sensor: bool
) -> None:
    """Return when a movement has arrived.

    Args:
        intervals: Telemetry, from before the movement or later.
        axis: Name of the axis.
        motion: Number of the movement.
        has_sensor: Whether the axis has a sensor.

    Raises:
        NotReachedError: If the movement ends before its target.
        ClientError: If the daemon ends.
    """
    async for interval in intervals:
        if arrival(interval, motion, axis):
            return
        now = interval.axes[axis]
        command_um, target_um = now.command_um.last, now.target_um
        if has_sensor or now.motion != motion or command_um is None or target_um is None:
            continue
        if abs(command_um - target_um) <= SAME_UM:
            return
