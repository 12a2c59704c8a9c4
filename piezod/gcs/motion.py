"""The commands that change something: servo, movements, stop."""

from piezod.client.mover import StageMover
from piezod.config.states import State
from piezod.gcs.errors import Code, GcsRefusal
from piezod.gcs.queries import number
from piezod.gcs.readings import AxisNow, Readings
from piezod.gcs.syntax import IS_READY, ids_in, pairs_in


class MotionCommands:
    """The commands of one connection.

    Args:
        mover: Moves and stops for it, with a lease of its own.
        readings: Status and limits of the stage.
        mode: The mode that `SVO 1` selects.
    """

    def __init__(self, mover: StageMover, readings: Readings, mode: str) -> None:
        self._mover, self._readings, self._mode = mover, readings, mode
        self._speeds_um_per_s: dict[str, float] = {}
        self._following = False

    async def set_servo(self, arguments: str) -> None:
        """Carry out `SVO`: 1 arms the stage and follows positions, 0 holds the voltage.

        Raises:
            GcsRefusal: If the arguments are invalid.
            ClientError: If the daemon refuses.
        """
        pairs = pairs_in(arguments, tuple(await self._readings.axes()))
        if any(value not in {0.0, 1.0} for value in pairs.values()):
            raise GcsRefusal(Code.OUT_OF_RANGE, "the servo is 0 or 1")
        self._readings.mirror.expire()
        try:
            for axis, value in pairs.items():
                await (self._switch_on(axis) if value else self._switch_off())
        finally:
            self._readings.mirror.expire()

    async def move(self, arguments: str) -> None:
        """Carry out `MOV`: nothing moves if one of the positions is out of its limits.

        Raises:
            GcsRefusal: If a servo is off, or a position is out of its limits.
            ClientError: If the daemon refuses.
        """
        axes = await self._readings.axes()
        await self._go(axes, pairs_in(arguments, tuple(axes)))

    async def move_relative(self, arguments: str) -> None:
        """Carry out `MVR`, relative to the targets; as `move`."""
        axes = await self._readings.axes()
        steps = pairs_in(arguments, tuple(axes)).items()
        await self._go(axes, {axis: axes[axis].target_um + um for axis, um in steps})

    async def set_speed(self, arguments: str) -> None:
        """Carry out `VEL`: the speed of the movements of this connection.

        Raises:
            GcsRefusal: If a speed is not allowed.
        """
        axes = await self._readings.axes()
        speeds = pairs_in(arguments, tuple(axes))
        for axis, speed in speeds.items():
            if why := axes[axis].limits.why_not_speed(speed):
                raise GcsRefusal(Code.VELOCITY_LIMITS, f"axis {axis}: {why}")
        self._speeds_um_per_s.update({axes[axis].name: speed for axis, speed in speeds.items()})

    def speed(self, now: AxisNow) -> str:
        """Return the speed of movements, in µm/s, for `VEL?`."""
        return number(self._speeds_um_per_s.get(now.name) or now.limits.speed_um_per_s)

    async def stop(self, arguments: str = "") -> None:
        """Carry out `STP`, `HLT` and `#24`: hold the voltage at once.

        A connection that has switched the servo on then resumes at the present position, because
        the servo of a PI controller stays on.

        Raises:
            GcsRefusal: Always, with the code "stopped"; or because an axis is unknown.
        """
        mirror = self._readings.mirror
        await self._mover.stop(mirror.state, resume=self._following)
        mirror.expire()
        if arguments:
            ids_in(arguments, tuple(await self._readings.axes()))
        raise GcsRefusal(Code.STOPPED, "")

    async def reference(self, arguments: str) -> None:
        """Carry out `FRF`: nothing, because a stage of piezod is always referenced."""
        ids_in(arguments, tuple(await self._readings.axes()))

    async def _switch_on(self, axis: str) -> None:
        readings = self._readings
        state = await readings.state()
        if state == State.HOLD:
            await self._mover.link.resume()
        elif state not in {State.RUN, State.IDENT}:
            await self._mover.link.arm()
        readings.mirror.expire()
        now = (await readings.axes())[axis]
        if now.state == State.IDENT:  # `conditioning.on_arm`
            why = f"the stage is being conditioned: when {IS_READY} reports ready, SVO {axis} 1"
            raise GcsRefusal(Code.INITIALISING, why)
        if not now.servo_on:
            await self._mover.link.mode(self._mode, axis=now.name)
            readings.mirror.expire()
        self._following = True

    async def _switch_off(self) -> None:
        self._following = False
        await self._mover.stop(self._readings.mirror.state, resume=False)

    async def _go(self, axes: dict[str, AxisNow], targets_um: dict[str, float]) -> None:
        for axis, um in targets_um.items():
            now = axes[axis]
            if not now.servo_on:
                why = f"axis {axis} is in {now.state}, mode {now.status.mode}: SVO {axis} 1 first"
                raise GcsRefusal(Code.SERVO_OFF, why)
            if why := now.limits.why_not(um):
                raise GcsRefusal(Code.POSITION_LIMITS, f"axis {axis}: {why}")
        targets = {axes[axis].name: um for axis, um in targets_um.items()}
        try:
            await self._mover.goto(targets, self._speeds_um_per_s)
        finally:
            self._readings.mirror.expire()
        self._following = True
