"""An axis of a stage: a motor of Bluesky."""

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass

from bluesky.protocols import Checkable, Locatable, Location, Reading, Stoppable, Subscribable
from event_model import Limits, LimitsRange
from ophyd_async.core import (
    CALCULATE_TIMEOUT,
    AsyncStatus,
    CalculatableTimeout,
    Callback,
    DeviceMock,
    SignalMetadata,
    StandardReadable,
    WatchableAsyncStatus,
    WatcherUpdate,
    callback_on_mock_put,
    default_mock_class,
    observe_value,
    set_mock_value,
)
from ophyd_async.core import StandardReadableFormat as Format

from piezod.bluesky.connected_stage import ConnectedStage
from piezod.bluesky.motion import move_to
from piezod.bluesky.recorded import Column
from piezod.bluesky.signals import SignalSource, configured, movable, readable
from piezod.errors import NotReachedError, RefusedError
from piezod.messages.shown import unit_of


@dataclass
class Movement:
    """A movement that `stop` may end."""

    #: Whether it may take no longer than the daemon says, and some time to settle.
    limited: bool = True
    ended: str = ""  #: Empty; "success" or "failure" if it was ended before its target.
    status: AsyncStatus[None] | None = None  #: The wait for its arrival, once it has begun.

    def end(self, *, success: bool) -> None:
        """End the wait, or do not let it begin."""
        if self.status is None or not self.status.done:
            self.ended = "success" if success else "failure"
        if self.status is not None:
            self.status.task.cancel()


class InstantAxis(DeviceMock["PiezoAxis"]):
    """An axis in mock mode arrives at once."""

    async def connect(self, device: "PiezoAxis") -> None:
        """Let the position follow the set-point."""
        set_mock_value(device.speed, math.inf)
        set_mock_value(device.low_limit, -math.inf)
        set_mock_value(device.high_limit, math.inf)
        callback_on_mock_put(device.setpoint, lambda um: set_mock_value(device.position, um))


@default_mock_class(InstantAxis)
class PiezoAxis(
    StandardReadable, Locatable[float], Checkable[float], Stoppable, Subscribable[float]
):
    """An axis: `set` returns when it is on target, or fails with the reason.

    `read` has the measured position under the name of the axis, the command, the error (command
    minus position) and the drive voltage, all of one cycle; `read_configuration` mode, speed and
    limits. An axis whose movement was interrupted or has failed is held by `stop`.

    Args:
        link: Connection to the stage.
        axis: Name of the axis in the configuration of the stage.

    Attributes:
        position: Measured position, in µm; NaN if it is unknown.
        setpoint: Target, in µm; to set it is to move.
        command: Commanded position, in µm.
        error: Command minus position, in µm.
        drive: Drive voltage, in V.
        mode: Mode of the compensator.
        speed: Configured speed of movements, in µm/s.
        low_limit: Lowest position, in µm; NaN if the configuration has none.
        high_limit: Highest position, in µm; likewise.
    """

    def __init__(self, link: ConnectedStage, axis: str) -> None:
        self._link, self._axis = link, axis
        self._movement = Movement()
        with self.add_children_as_readables(Format.HINTED_UNCACHED_SIGNAL):
            self.position = readable(link, self._measured("position_um"))
        with self.add_children_as_readables(Format.UNCACHED_SIGNAL):
            self.command = readable(link, self._measured("command_um"))
            self.error = readable(link, self._measured("error_um"))
            self.drive = readable(link, self._measured("drive_v"))
        with self.add_children_as_readables(Format.CONFIG_SIGNAL):
            self.mode = readable(
                link,
                SignalSource(
                    f"{axis}/mode",
                    str,
                    lambda status: status.axes[axis].mode,
                    lambda interval: interval.axes[axis].mode,
                ),
            )
            self.speed, self._set_speed = configured()
            self.low_limit, self._set_low_limit = configured()
            self.high_limit, self._set_high_limit = configured()
        target = SignalSource(
            f"{axis}/target_um",
            float,
            lambda status: status.axes[axis].target_um,
            lambda interval: interval.axes[axis].target_um,
            self._metadata("target_um"),
        )
        self.setpoint = movable(link, target, self._move_to)
        super().__init__()

    def set_name(self, name: str, *, child_name_separator: str | None = None) -> None:
        """Name the axis and its signals; the position has the name of the axis."""
        super().set_name(name, child_name_separator=child_name_separator)
        self.position.set_name(name)

    async def check_value(self, value: float) -> None:
        """Check a target without moving.

        Raises:
            RefusedError: If it is out of the limits of the axis.
        """
        low_um, high_um = await asyncio.gather(
            self.low_limit.get_value(), self.high_limit.get_value()
        )
        if not math.isfinite(value) or value < low_um or value > high_um:
            what = f"{self.name}: position out of range (got {value:g} {self._unit})"
            allowed = f"{low_um:g} to {high_um:g} {self._unit}"
            remedy = f"allowed: {allowed}, the range of the axis"
            raise RefusedError(what, remedy, "value")

    def set(
        self, value: float, timeout: CalculatableTimeout = "CALCULATE_TIMEOUT"
    ) -> WatchableAsyncStatus[float]:
        """Move; done when the position has been within its tolerance for the settling time.

        Args:
            value: Target, in µm.
            timeout: Longest time, in s; None for no limit. If it is not given, it is the time that
                the movement takes, as the daemon says, and 30 s.

        Raises:
            NotReachedError: If the movement was stopped, held, replaced, or takes too long.
            ClientError: If the daemon refuses it, or ends.
        """
        # Before anything is awaited: `stop` may come before the task begins.
        self._movement = Movement(limited=timeout == CALCULATE_TIMEOUT)
        return WatchableAsyncStatus(self._moves(value, timeout, self._movement), self.name)

    async def _moves(
        self, value: float, timeout: CalculatableTimeout, movement: "Movement"
    ) -> AsyncIterator[WatcherUpdate[float]]:
        await self.check_value(value)
        initial_um = await self.position.get_value()
        longest_s = timeout if isinstance(timeout, int | float) else None
        try:
            async with AsyncStatus(self._go(value, longest_s, movement)) as movement.status:
                async for current_um in observe_value(self.position, done_status=movement.status):
                    yield WatcherUpdate(
                        current=current_um,
                        initial=initial_um,
                        target=value,
                        name=self.name,
                        unit=self._unit,
                        precision=unit_of("position_um").fine,
                    )
        except asyncio.CancelledError:
            if not movement.ended:
                raise
        if movement.ended == "failure":
            raise NotReachedError(f"{self.name}: stopped before it reached {value:g} {self._unit}")

    async def stop(self, success: bool = False) -> None:
        """Hold the stage, with all of its axes, if a movement of this axis has not arrived.

        Otherwise nothing happens: the RunEngine calls this after each plan. The next movement
        resumes.

        Args:
            success: Whether the movement counts as done; otherwise it fails.
        """
        self._movement.end(success=success)
        if self._axis in self._link.moving:
            await self._link.hold()

    def interrupt(self) -> None:
        """End the wait of `set`, as if the axis had arrived; the stage moves on."""
        self._movement.end(success=True)

    async def locate(self) -> Location[float]:
        """Return target and measured position, in µm."""
        target_um, position_um = await asyncio.gather(
            self.setpoint.get_value(), self.position.get_value()
        )
        return Location(setpoint=target_um, readback=position_um)

    def subscribe_reading(self, function: Callback[dict[str, Reading[float]]]) -> None:
        """Call a function with each new position, about 20 times a second."""
        self.position.subscribe_reading(function)

    subscribe = subscribe_reading

    def clear_sub(self, function: Callback[dict[str, Reading[float]]]) -> None:
        """Remove a subscription."""
        self.position.clear_sub(function)

    async def _move_to(self, um: float) -> None:
        await move_to(self._link, self._axis, um, limited=self._movement.limited)

    async def _go(self, value: float, timeout_s: float | None, movement: "Movement") -> None:
        if movement.ended:
            return
        try:
            await self.setpoint.set(value, timeout=timeout_s)
        except TimeoutError as error:
            what = f"{self.name}: {value:g} {self._unit} not reached within {timeout_s:g} s"
            remedy = "is the tolerance above the noise, and the mode one that corrects the error?"
            raise NotReachedError(what, remedy, "timeout") from error

    def columns(self) -> list[Column]:
        """Return the columns of a recording that have the values of this axis."""
        group = f"recording/axis_{self._axis}"
        return [
            Column(signal.name, f"{group}/{name}", signal.source, self._metadata(name)())
            for signal, name in (
                (self.position, "position_um"),
                (self.command, "command_um"),
                # The voltage that was in force when the position was measured.
                (self.drive, "in_force_v"),
            )
        ]

    def set_limits(self) -> None:
        """Take the limits from the configuration in force."""
        facts, unit = self._link.facts[self._axis], unit_of("position_um", self._unit)
        self._set_speed(
            facts.speed_um_per_s, SignalMetadata(units=f"{unit.ascii}/s", precision=unit.fine)
        )
        position = SignalMetadata(units=unit.ascii, precision=unit.fine)
        self._set_low_limit(facts.range_um[0], position)
        self._set_high_limit(facts.range_um[1], position)

    def _measured(self, quantity: str) -> SignalSource[float]:
        return SignalSource(
            f"{self._axis}/{quantity}",
            float,
            lambda status: getattr(status.axes[self._axis], quantity),
            lambda interval: getattr(interval.axes[self._axis], quantity).last,
            self._metadata(quantity),
        )

    @property
    def _unit(self) -> str:
        facts = self._link.facts.get(self._axis)  # not in mock mode
        return facts.unit if facts else "µm"

    def _metadata(self, quantity: str) -> Callable[[], SignalMetadata]:
        def metadata() -> SignalMetadata:
            facts = self._link.facts.get(self._axis)
            unit = unit_of(quantity, self._unit)
            found = SignalMetadata(units=unit.ascii, precision=unit.fine)
            if facts:
                low, high = facts.drive_v if unit.sign == "V" else facts.range_um
                found["limits"] = Limits(control=LimitsRange(low=low, high=high))
            return found

        return metadata
