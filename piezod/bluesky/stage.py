"""A stage with its axes, as a device of Bluesky."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ophyd_async.core import (
    AsyncStatus,
    Device,
    DeviceConnector,
    NotConnectedError,
    PathProvider,
    SignalMetadata,
    StandardReadable,
)

from piezod.bluesky.axis import PiezoAxis
from piezod.bluesky.connected_stage import ConnectedStage
from piezod.bluesky.flyer import PiezoFlyer
from piezod.bluesky.recorded import Column
from piezod.bluesky.signals import SignalSource, readable
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.errors import ClientError, RefusedError


class StageConnector(DeviceConnector):
    """Connects a stage and its axes to the daemon."""

    def __init__(self, link: ConnectedStage, axes: dict[str, PiezoAxis]) -> None:
        self._link, self._axes = link, axes

    async def connect_real(self, device: Device, timeout: float, force_reconnect: bool) -> None:
        """Connect to the daemon.

        Raises:
            NotConnectedError: If no daemon answers in time, or it has no such axis.
        """
        try:
            async with asyncio.timeout(timeout):
                await self._link.connect(tuple(self._axes))
        except (ClientError, TimeoutError) as error:
            await self._link.close()
            why = str(error) or f"{self._link.title}: the daemon does not answer in time"
            raise NotConnectedError(why) from error
        for axis in self._axes.values():
            axis.set_limits()
        await super().connect_real(device, timeout, force_reconnect)


class PiezoStage(StandardReadable):
    """A running stage; each axis is an attribute, for example `stage.x`.

    `stage` takes the lease, so that nobody else moves the stage during the plan, and resumes a
    stage that this process has held. `unstage` releases the lease; the stage stays where it is.

    Args:
        stage: Name of the stage: the stem of the file name of its configuration. None for the only
            stage that runs.
        axes: Names of its axes in the configuration.
        socket: Socket of the daemon, in place of a name.
        path_provider: Names the files of fly scans, see `PiezoFlyer`.
        arm: Whether `stage` arms a stage that is disarmed.
        mode: Mode that `stage` selects for these axes; None leaves the modes as they are.
        hold_at_end: Whether `unstage` holds the voltage; otherwise the stage follows its command,
            and stays at its target.
        name: Name of the device.

    Attributes:
        axes: The axes, by name.
        flyer: Follows waves, scans, and lets the device play tables.
        state: State of the stage.
        faults: Ids of the faults, separated by commas.
    """

    def __init__(  # noqa: PLR0913 - each argument is an option
        self,
        stage: str | None = None,
        *,
        axes: Sequence[str],
        socket: Path | None = None,
        path_provider: PathProvider | None = None,
        arm: bool = False,
        mode: Mode | str | None = None,
        hold_at_end: bool = False,
        name: str = "",
    ) -> None:
        self.link = link = ConnectedStage(stage, socket)
        self._arm, self._mode, self._hold_at_end = arm, mode, hold_at_end
        self._staged = False
        self.axes = {axis: PiezoAxis(link, axis) for axis in axes}
        for axis, device in self.axes.items():
            if hasattr(type(self), axis):
                raise ValueError(f"axis {axis!r} has the name of an attribute of this device")
            setattr(self, axis, device)
        self.add_readables(list(self.axes.values()))
        state = SignalSource("state", str, lambda now: now.state, lambda now: now.state)
        self.state = readable(link, state)
        faults = SignalSource(
            "faults",
            str,
            lambda now: ", ".join(fault.id for fault in now.faults),
            lambda now: ", ".join(now.faults),
        )
        self.faults = readable(link, faults)
        self.flyer = PiezoFlyer(link, self._columns, path_provider)
        super().__init__(name, connector=StageConnector(link, self.axes))

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> PiezoAxis: ...

    @AsyncStatus.wrap
    async def stage(self) -> None:
        """Take the lease, and make the stage ready to move.

        Raises:
            RefusedError: If another client has the lease, or the stage is not armed.
            ClientError: If the daemon does not answer.
        """
        if self._staged or self._mock is not None:
            return
        await self.link.mover.take_lease(self)
        self.link.commanded = True
        try:
            await self._make_ready()
        except BaseException:
            await self.link.mover.return_lease(self)
            raise
        self._staged = True

    @AsyncStatus.wrap
    async def unstage(self) -> None:
        """Release the lease; hold the stage if a movement goes on, or if that was chosen.

        Raises:
            ClientError: If the stage cannot be held.
        """
        if not self._staged:
            return
        self._staged = False
        try:
            if self.link.moving or self.flyer.flies or self._hold_at_end:
                await self.hold()
        finally:
            await self.link.mover.return_lease(self)

    async def hold(self) -> None:
        """Hold the voltage of all axes; movements that this process has started count as done.

        Raises:
            ClientError: If the daemon does not answer, or does not allow it.
        """
        for axis in self.axes.values():
            axis.interrupt()
        await self.flyer.land()
        await self.link.hold()

    async def disconnect(self) -> None:
        """Release the lease and close the connection; the stage stays where it is."""
        self._staged = False
        await self.link.close()

    def _columns(self) -> list[Column]:
        columns = [column for axis in self.axes.values() for column in axis.columns()]
        time = SignalMetadata(units="s", precision=6)
        source = f"piezod://{self.link.title}/t_s"
        return [*columns, Column(f"{self.name}-t", "recording/cycles/t_s", source, time)]

    async def _make_ready(self) -> None:
        link = self.link
        await link.read_facts()
        for axis in self.axes.values():
            axis.set_limits()
        await link.mover.go_on()
        state = (await link.mirror.status()).state
        if state == State.SAFE and self._arm:
            await link.daemon.arm()
            state = State.READY
        if state not in {State.READY, State.RUN}:
            what = f"stage {link.title} is in {state}"
            raise RefusedError(what, "arm, resume or reset it before the plan", "state")
        if self._mode is not None:
            for name in self.axes:
                await link.daemon.mode(self._mode, axis=name)
