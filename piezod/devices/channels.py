"""The channels of all axes as one sensor and one amplifier, with one transaction per device."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from math import isnan, nan
from typing import Final

from piezod.devices.interface import (
    Amplifier,
    Capabilities,
    Device,
    Identity,
    KnowsTruth,
    Sample,
    Sensor,
)
from piezod.devices.line_levels import LineLevels
from piezod.devices.outputs import ANY_VALUE, CalibratedOutput
from piezod.devices.roles import AmplifierRole, SensorRole, places, sensor_role, wrong_role
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags, TellsStatus
from piezod.devices.wiring import NO_LINES, ChannelPair, Lines, wiring_of
from piezod.devices.wrapper import DeviceWrapper
from piezod.errors import DeviceError

_HALF: Final = 0.5  # between the values of a low and a high line
_EACH_COMES: Final = Sample(0, nan, False)  # in each cycle, in place of this one


class Channels:
    """Implements `Sensor`, `Amplifier`, `KnowsTruth` and `TellsStatus` for all axes.

    Args:
        devices: Constructed devices by name, each for its `wiring_of`.
        axes: Channels of each axis; their order is that of every sequence.
        lines: The lines of the loop by name.

    Raises:
        DeviceError: If a device cannot play the role that an axis gives it.
    """

    def __init__(
        self,
        devices: Mapping[str, Device],
        axes: Mapping[str, ChannelPair],
        lines: Lines = NO_LINES,
    ) -> None:
        self._pairs, self._axes, self._lines = axes, tuple(axes), lines
        self.levels = levels = LineLevels([False] * len(lines), [False] * len(lines))
        """Levels of the lines: `read` fills in the inputs, `write` sets the outputs."""
        self._line_high, self._line_unknown = levels.high, levels.unknown
        self._outputs = [CalibratedOutput(pair.to_v) for pair in axes.values()]
        self._commands = [Sample(0, nan, False)] * len(axes)
        self.identities: dict[str, Identity] = {}
        """Identity of each device, from its last opening."""
        self._zero_um = [0.0] * len(axes)
        self._true_zero_um = [0.0] * len(axes)
        self._no_flags = [NO_FLAGS] * (2 * len(axes))
        self._lags_ns = [0] * len(devices)  # of the amplifiers; known as soon as they are open
        self._no_age_ns = [0] * len(axes)
        self.use(devices)

    @property
    def devices(self) -> Mapping[str, Device]:
        """Devices by name."""
        return self._devices

    def use(self, devices: Mapping[str, Device]) -> None:
        """Use these objects for the devices from now on, for example their wrappers.

        Raises:
            DeviceError: If a device cannot play the role that an axis gives it.
        """
        # The roles are sorted out here, once, so that a cycle only walks through these lists.
        self._devices = devices
        self._sensors: list[SensorRole] = []
        self._amplifiers: list[AmplifierRole] = []
        self._line_devices: list[AmplifierRole] = []  # they drive no axis
        self._truths: list[tuple[KnowsTruth, list[tuple[int, int]]]] = []
        self._status_sources: list[
            tuple[TellsStatus, list[tuple[int, int]], list[tuple[int, int]]]
        ] = []
        for name, device in devices.items():
            self._assign_roles(name, device)
        self._lines_low = [True] * len(self._line_devices)  # as far as we have set them
        of_lines = [role.amplifier for role in self._line_devices]
        # At an end a device of lines alone must not delay a voltage.
        self._ending = sorted(devices.values(), key=lambda device: device in of_lines)
        self._find_ages()
        measured = sum(len(of.plain) + len(of.calibrated) for of in self._sensors)
        self._all_measured = measured == len(self._axes)
        self._light_dependent = [
            (one, axis) for of in self._sensors for one, axis in of.calibrated if one.needs_light
        ]

    def _assign_roles(self, name: str, device: Device) -> None:
        """Find the roles of a device: which of its channels serve which axes."""
        axes = self._pairs
        wiring = wiring_of(name, axes, self._lines)
        lines = [(i, line) for i, line in enumerate(self._lines.values()) if line.device == name]
        measured, driven = places(name, wiring, axes)
        if wiring.inputs:
            if not isinstance(device, Sensor):
                raise wrong_role(name, "sensor")
            role = sensor_role(name, device, wiring, axes)
            role.lines.extend(
                (wiring.inputs.index(line.input), i) for i, line in lines if line.input
            )
            self._sensors.append(role)
            if measured and isinstance(device, KnowsTruth):
                self._truths.append((device, measured))
        if wiring.outputs:
            if not isinstance(device, Amplifier):
                raise wrong_role(name, "amplifier")
            driven_axes = [axis for _, axis in driven]
            outputs = [self._outputs[axis] for axis in driven_axes]
            set_lines = [i for i, line in lines if line.output]
            roles = self._amplifiers if driven else self._line_devices
            roles.append(AmplifierRole(device, driven_axes, outputs, set_lines))
        if isinstance(device, TellsStatus):
            # A status lists inputs, then outputs: of the device's channels, and of our axes.
            after_inputs = len(wiring.inputs)
            outputs_at = [(after_inputs + channel, len(axes) + axis) for channel, axis in driven]
            lines_at = [
                (after_inputs + wiring.outputs.index(line.output), i)
                for i, line in lines
                if line.output
            ]
            self._status_sources.append((device, measured + outputs_at, lines_at))

    def open(self) -> Identity:
        """Open every device; if one fails with any error, close all again."""
        try:
            for name, device in self._devices.items():
                self.identities[name] = device.open()
            self._ask_outputs()
        except BaseException:
            with suppress(Exception):  # report the cause of the failed opening, not this one
                self.close()
            raise
        return Identity(
            *(" + ".join(parts) for parts in zip(*self.identities.values(), strict=True))
        )

    def capabilities(self) -> Capabilities:
        """Return the common capabilities of all devices."""
        each = [device.capabilities() for device in self._devices.values()]
        driving = [role.amplifier.capabilities() for role in self._amplifiers]
        # `all` for a service that must not be missing on any device; `any` for a property that the
        # caller must take care of even if only one device has it.
        return Capabilities(
            self._axes,
            self._axes,
            all(one.read_back for one in driving),
            min(one.max_rate_hz for one in each),
            any(one.holds for one in driving),
            all(one.opens_relaxed for one in driving),
            any(one.enables for one in driving),
            all(one.soft_disable for one in driving),
            all(one.watchdog for one in driving),
            all(one.quality for one in each if one.inputs),
            max((one.lag_ns for one in driving), default=0),
            tells_restart=all(one.tells_restart for one in driving),
        )

    def reads_back(self) -> list[bool]:
        """Return of each axis whether its amplifier reads back; known when the devices are open."""
        reads_back = [False] * len(self._axes)
        for amplifier, axes, *_ in self._amplifiers:
            for axis in axes:
                reads_back[axis] = amplifier.capabilities().read_back
        return reads_back

    def beyond_reach(self, limits_v: Sequence[tuple[float, float]]) -> str:
        """Return a message on an axis whose limits exceed its amplifier's range, or "".

        Args:
            limits_v: Lowest and highest voltage of each axis, in V.
        """
        for axis, output, (low_v, high_v) in zip(self._axes, self._outputs, limits_v, strict=True):
            if not (output.reaches(low_v) and output.reaches(high_v)):
                ends_v = output.reach_v()
                return (
                    f"the limits of axis {axis} are {low_v:g} to {high_v:g} V, but its amplifier "
                    f"gives {ends_v[0]:g} to {ends_v[1]:g} V: change the limits of the axis, or "
                    "the range of the amplifier in the configuration or on the device"
                )
        return ""

    def activate(self, now_ns: int) -> None:
        """Prepare every device for cyclic calls."""
        for device in self._devices.values():
            device.activate(now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Bring the outputs of every device to rest, even if one driver fails.

        Lines of devices that drive no axis are low then.
        """
        self._line_high[:] = [False] * len(self._line_high)

        def bring_to_rest(device: Device) -> None:
            for place, role in enumerate(self._line_devices):
                if role.amplifier is device:
                    with suppress(Exception):  # it has to be deactivated nevertheless
                        self._set_lines_of(place, now_ns, at_rest=True)
            device.deactivate(now_ns)

        self._for_each_device(bring_to_rest)

    def close(self) -> None:
        """Make the outputs of every device safe and release it, even if one driver fails."""
        self._for_each_device(lambda device: device.close())

    def zero(self, zero_um: Sequence[float], true_zero_um: Sequence[float]) -> None:
        """Use these displacements as zero from now on.

        Args:
            zero_um: Measured displacement of each axis, in µm as the devices give it.
            true_zero_um: True displacement of each axis, in µm; ignored if it is not known.
        """
        self._zero_um = list(zero_um)
        self._true_zero_um = list(true_zero_um)

    def zero_um(self, axis: int) -> float:
        """Return the displacement that counts as zero on an axis, in µm."""
        return self._zero_um[axis]

    def read(self, now_ns: int) -> list[Sample]:
        """Return one sample of each axis, relative to its zero. Real-time safe."""
        missing = _EACH_COMES if self._all_measured else Sample(now_ns, 0.0, False)
        samples = [missing] * len(self._axes)
        for sensor, plain, calibrated, commanding, lines in self._sensors:
            raw = sensor.read(now_ns)
            for channel, axis in plain:
                t_ns, position_um, valid = raw[channel]
                fields = t_ns, position_um - self._zero_um[axis], valid
                samples[axis] = tuple.__new__(Sample, fields)  # three times as fast as `Sample()`
            for one, axis in calibrated:
                t_ns, position_um, valid = one.sample(raw)
                samples[axis] = Sample(t_ns, position_um - self._zero_um[axis], valid)
            # A command is not measured, so the zero is not subtracted from it.
            for one, axis in commanding:
                self._commands[axis] = one.sample(raw)
            for channel, line in lines:
                _, value, valid = raw[channel]
                self._line_unknown[line] = not valid
                if valid:
                    self._line_high[line] = value > _HALF
        return samples

    def forget(self) -> None:
        """Drop what the wrappers of the devices have read before. Real-time safe."""
        for device in self._devices.values():
            if isinstance(device, DeviceWrapper):
                device.forget()

    def commands(self) -> Sequence[Sample]:
        """Return the command of each axis from the last `read`. Real-time safe.

        Returns:
            Positions in µm; not valid if no input commands the axis.
        """
        return self._commands

    def true_position_um(self, now_ns: int) -> list[float]:
        """Return the true displacement of each axis, relative to its zero. Real-time safe.

        Returns:
            Displacements in µm; NaN if the sensor of an axis does not know it.
        """
        position_um = [nan] * len(self._axes)
        for device, measured in self._truths:
            true_um = device.true_position_um(now_ns)
            for channel, axis in measured:
                position_um[axis] = true_um[channel] - self._true_zero_um[axis]
        return position_um

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set the voltage of every axis, in V. Real-time safe.

        Args:
            drive_v: Voltage of each axis, in V. A device that drives an axis with NaN is left
                alone: it gets all its values in one transaction.
            now_ns: Instant of the cycle, in ns.

        Returns:
            Whether every device that was written accepted its values.
        """
        accepted, whole = True, not isnan(sum(drive_v))
        for amplifier, axes, outputs, lines in self._amplifiers:
            if not whole and any(isnan(drive_v[axis]) for axis in axes):
                continue
            values = []
            for place, one in enumerate(outputs):
                value = drive_v[axes[place]]
                # Most outputs take volts of any size; a call less for each counts in the loop.
                values.append(value if one.takes_any_voltage else one.value(value))
            for line in lines:
                values.append(float(self._line_high[line]))
            # No early return: the axes of the other devices must not miss their setpoints.
            taken = amplifier.write(values, now_ns)
            accepted &= taken
            for line in lines:
                self._line_unknown[line] = not taken
        return accepted

    def set_lines(self, now_ns: int, *, at_rest: bool) -> None:
        """Set the lines of devices that drive no axis. Real-time safe.

        Args:
            now_ns: Instant of the cycle, in ns.
            at_rest: Whether to leave devices alone whose lines are low already.
        """
        for place in range(len(self._line_devices)):
            self._set_lines_of(place, now_ns, at_rest=at_rest)

    def _set_lines_of(self, place: int, now_ns: int, *, at_rest: bool) -> None:
        if at_rest and self._lines_low[place]:
            return
        amplifier, _, _, lines = self._line_devices[place]
        values = [float(self._line_high[line]) for line in lines]
        self._lines_low[place] = False
        taken = amplifier.write(values, now_ns)
        self._lines_low[place] = taken and not any(values)
        for line in lines:
            self._line_unknown[line] = not taken

    def read_back(self, now_ns: int) -> list[float]:
        """Return the read-back voltage of each axis, in V. Real-time safe."""
        drive_v = [nan] * len(self._axes)
        for amplifier, axes, outputs, lines in self._amplifiers:
            values = amplifier.read_back(now_ns)
            if len(values) != len(axes) + len(lines):
                raise DeviceError(f"{len(values)} voltages were read back, not {len(axes)}")
            for place, one in enumerate(outputs):
                value = values[place]
                drive_v[axes[place]] = value if one.takes_any_voltage else one.voltage(value)
        return drive_v

    def watchdogs(self) -> list[bool]:
        """Return of each axis whether its amplifier has a watchdog of its own."""
        found = [False] * len(self._axes)
        for amplifier, axes, *_ in self._amplifiers:
            for axis in axes:
                found[axis] = amplifier.capabilities().watchdog
        return found

    def read_back_age_ns(self, now_ns: int) -> list[int]:
        """Return the age of the last read-back of each axis, in ns. Real-time safe."""
        if not self._is_aged:
            return self._no_age_ns
        ages_ns = [0] * len(self._axes)
        for (amplifier, axes, *_), lag_ns in zip(self._amplifiers, self._lags_ns, strict=False):
            age_ns = lag_ns
            if isinstance(amplifier, DeviceWrapper):
                age_ns = amplifier.read_back_age_ns(now_ns)
            for axis in axes:
                ages_ns[axis] = age_ns
        return ages_ns

    def status(self, now_ns: int) -> list[Flags]:
        """Return the flags of the sensor of each axis, then of each amplifier. Real-time safe.

        A device without status contributes no flags.
        """
        if not self._status_sources and not self._light_dependent:
            return self._no_flags
        # A copy, because a cycle without flags returns the shared list.
        flags = self._no_flags.copy()
        for device, served, lines in self._status_sources:
            reported = device.status(now_ns)
            for channel, place in served:
                flags[place] = reported[channel]
            for channel, line in lines:
                self._line_unknown[line] |= bool(reported[channel])
        for one, axis in self._light_dependent:
            if one.low_light:
                flags[axis] |= {DeviceFlag.LOW_LIGHT}
        return flags

    def _ask_outputs(self) -> None:
        # Some devices know range and delay only after opening, because they are set on the device.
        for amplifier, axes, outputs, _ in self._amplifiers:
            ranges = amplifier.capabilities().ranges or [ANY_VALUE] * len(axes)
            for output, range_ in zip(outputs, ranges[: len(axes)], strict=True):
                output.set_range(*range_)
        self._lags_ns = [one.amplifier.capabilities().lag_ns for one in self._amplifiers]
        self._find_ages()

    def _find_ages(self) -> None:
        """Find out whether a read-back can be older than the cycle that asks for it."""
        wrapped = any(isinstance(one.amplifier, DeviceWrapper) for one in self._amplifiers)
        self._is_aged = wrapped or any(self._lags_ns)

    def _for_each_device(self, do: Callable[[Device], None]) -> None:
        """Call a function for every device; raise the first failure after all calls."""
        failures = []
        for device in self._ending:
            try:
                do(device)
            except BaseException as failure:  # noqa: BLE001 - raised below
                failures.append(failure)
        if failures:
            raise failures[0]
