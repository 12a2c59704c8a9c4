"""The channels of all axes as one sensor and one amplifier, a transaction per device and cycle."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from math import nan
from typing import NamedTuple

from piezod.devices.inputs import CalibratedInput
from piezod.devices.interface import (
    Amplifier,
    Capabilities,
    Device,
    Identity,
    KnowsTruth,
    Sample,
    Sensor,
    Wiring,
)
from piezod.devices.outputs import ANY_VALUE, CalibratedOutput
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags, TellsStatus
from piezod.devices.wiring import ChannelPair, wiring_of
from piezod.errors import DeviceError


class _Measuring(NamedTuple):
    """A device that is read.

    Attributes:
        sensor: The device.
        plain: Input and axis of each displacement that it gives in µm.
        calibrated: Likewise of each that has to be made µm.
        commanding: Likewise of each that commands.
    """

    sensor: Sensor
    plain: list[tuple[int, int]]
    calibrated: list[tuple[CalibratedInput, int]]
    commanding: list[tuple[CalibratedInput, int]]


class _Driving(NamedTuple):
    """A device that is driven.

    Attributes:
        amplifier: The device.
        axes: The axis of each of its outputs.
        outputs: Each of them, in that order.
    """

    amplifier: Amplifier
    axes: list[int]
    outputs: list[CalibratedOutput]


class Channels:
    """Implements `Sensor`, `Amplifier`, `KnowsTruth` and `TellsStatus` for all axes.

    Args:
        devices: Constructed devices by name, each for its `wiring_of`.
        axes: The channels of each axis; their order is that of every sequence.

    Raises:
        DeviceError: If a device cannot play a role that an axis gives it.
    """

    def __init__(self, devices: Mapping[str, Device], axes: Mapping[str, ChannelPair]) -> None:
        self._pairs, self._axes = axes, tuple(axes)
        self._outputs = [CalibratedOutput(pair.to_v) for pair in axes.values()]
        self._commands = [Sample(0, nan, False)] * len(axes)
        self.identities: dict[str, Identity] = {}
        """Who each device said it is, when it was opened last."""
        self._zero_um = [0.0] * len(axes)
        self._true_zero_um = [0.0] * len(axes)
        self._no_flags = [NO_FLAGS] * (2 * len(axes))
        self.use(devices)

    @property
    def devices(self) -> Mapping[str, Device]:
        """The devices by name."""
        return self._devices

    def use(self, devices: Mapping[str, Device]) -> None:
        """Use these objects for the devices from now on, as what is put around each of them.

        Raises:
            DeviceError: If a device cannot play a role that an axis gives it.
        """
        self._devices = devices
        self._sensors: list[_Measuring] = []
        self._amplifiers: list[_Driving] = []
        self._truths: list[tuple[KnowsTruth, list[tuple[int, int]]]] = []
        self._tellers: list[tuple[TellsStatus, list[tuple[int, int]]]] = []
        for name, device in devices.items():
            self._give_roles(name, device)
        self._dim = [
            (one, axis) for of in self._sensors for one, axis in of.calibrated if one.needs_light
        ]

    def _give_roles(self, name: str, device: Device) -> None:
        axes = self._pairs
        wiring = wiring_of(name, axes)
        measured, driven = _places(name, wiring, axes)
        if wiring.inputs:
            if not isinstance(device, Sensor):
                raise _wrong_role(name, "sensor")
            self._sensors.append(_measuring(name, device, wiring, axes))
            if measured and isinstance(device, KnowsTruth):
                self._truths.append((device, measured))
        if driven:
            if not isinstance(device, Amplifier):
                raise _wrong_role(name, "amplifier")
            driven_axes = [axis for _, axis in driven]
            outputs = [self._outputs[axis] for axis in driven_axes]
            self._amplifiers.append(_Driving(device, driven_axes, outputs))
        if isinstance(device, TellsStatus):
            after_inputs = len(wiring.inputs)
            told = [(after_inputs + channel, len(axes) + axis) for channel, axis in driven]
            self._tellers.append((device, measured + told))

    def open(self) -> Identity:
        """Open every device; if one cannot be, whatever it raises, all are closed again."""
        try:
            for name, device in self._devices.items():
                self.identities[name] = device.open()
            self._ask_for_ranges()
        except BaseException:
            with suppress(Exception):  # what matters is why they could not be opened
                self.close()
            raise
        return Identity(
            *(" + ".join(parts) for parts in zip(*self.identities.values(), strict=True))
        )

    def capabilities(self) -> Capabilities:
        """Tell what all devices can do together."""
        each = [device.capabilities() for device in self._devices.values()]
        driving = [one for one in each if one.outputs]
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

    def beyond_reach(self, limits_v: Sequence[tuple[float, float]]) -> str:
        """Say which axis has limits that its amplifier cannot reach; nothing where none has.

        Args:
            limits_v: Lowest and highest voltage of each axis, in V.
        """
        for axis, output, (low_v, high_v) in zip(self._axes, self._outputs, limits_v, strict=True):
            if not (output.reaches(low_v) and output.reaches(high_v)):
                ends_v = output.reach_v()
                return (
                    f"axis {axis} may be driven from {low_v:g} to {high_v:g} V, "
                    f"its amplifier goes from {ends_v[0]:g} to {ends_v[1]:g} V: change the "
                    "limits of the axis, or what the amplifier is said or set to give"
                )
        return ""

    def activate(self, now_ns: int) -> None:
        """Make every device ready for cyclic calls."""
        for device in self._devices.values():
            device.activate(now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Bring the outputs of every device to rest, though one driver fails."""
        self._each(lambda device: device.deactivate(now_ns))

    def close(self) -> None:
        """Make the outputs of every device safe and let go of it, though one driver fails."""
        self._each(lambda device: device.close())

    def zero(self, zero_um: Sequence[float], true_zero_um: Sequence[float]) -> None:
        """Call these displacements zero from now on.

        Args:
            zero_um: Measured displacement of each axis, in µm as the devices give it.
            true_zero_um: True displacement of each axis, likewise; without effect where it is not
                known.
        """
        self._zero_um = list(zero_um)
        self._true_zero_um = list(true_zero_um)

    def read(self, now_ns: int) -> list[Sample]:
        """Take one sample of each axis, from its zero on; may be called in the loop."""
        samples = [Sample(now_ns, 0.0, False)] * len(self._axes)
        for sensor, plain, calibrated, commanding in self._sensors:
            taken = sensor.read(now_ns)
            for channel, axis in plain:
                t_ns, position_um, valid = taken[channel]
                samples[axis] = Sample(t_ns, position_um - self._zero_um[axis], valid)
            for one, axis in calibrated:
                t_ns, position_um, valid = one.sample(taken)
                samples[axis] = Sample(t_ns, position_um - self._zero_um[axis], valid)
            for one, axis in commanding:
                self._commands[axis] = one.sample(taken)
        return samples

    def commands(self) -> Sequence[Sample]:
        """Tell what commanded each axis when it was read last; may be called in the loop.

        Returns:
            Positions in µm; not valid where nothing commands the axis.
        """
        return self._commands

    def true_position_um(self, now_ns: int) -> list[float]:
        """Tell the true displacement of each axis, from its zero on; may be called in the loop.

        Returns:
            Displacements in µm; NaN where the sensor of an axis does not know it.
        """
        position_um = [nan] * len(self._axes)
        for device, measured in self._truths:
            true_um = device.true_position_um(now_ns)
            for channel, axis in measured:
                position_um[axis] = true_um[channel] - self._true_zero_um[axis]
        return position_um

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set the voltage of every axis, in V; may be called in the loop.

        Returns:
            Whether every device took its values.
        """
        taken = True
        for amplifier, axes, outputs in self._amplifiers:
            values = [one.value(drive_v[axis]) for axis, one in zip(axes, outputs, strict=True)]
            taken &= amplifier.write(values, now_ns)
        return taken

    def read_back(self, now_ns: int) -> list[float]:
        """Tell the voltage now in force, in V, per axis; may be called in the loop."""
        drive_v = [nan] * len(self._axes)
        for amplifier, axes, outputs in self._amplifiers:
            told = amplifier.read_back(now_ns)
            for axis, one, value in zip(axes, outputs, told, strict=True):
                drive_v[axis] = one.voltage(value)
        return drive_v

    def status(self, now_ns: int) -> list[Flags]:
        """Tell what is the matter with the sensor of each axis, then with the amplifier of each.

        May be called in the loop. Nothing is where a device does not tell its status.
        """
        if not self._tellers and not self._dim:
            return self._no_flags
        flags = self._no_flags.copy()
        for device, served in self._tellers:
            told = device.status(now_ns)
            for channel, place in served:
                flags[place] = told[channel]
        for one, axis in self._dim:
            if one.low_light:
                flags[axis] |= {DeviceFlag.LOW_LIGHT}
        return flags

    def _ask_for_ranges(self) -> None:
        for amplifier, axes, outputs in self._amplifiers:
            ranges = amplifier.capabilities().ranges or [ANY_VALUE] * len(axes)
            for output, range_ in zip(outputs, ranges, strict=True):
                output.range = range_

    def _each(self, do: Callable[[Device], None]) -> None:
        """Do something to every device; the first failure is raised when all had their turn."""
        failures = []
        for device in self._devices.values():
            try:
                do(device)
            except BaseException as failure:  # noqa: BLE001 - raised below
                failures.append(failure)
        if failures:
            raise failures[0]


def _places(
    device: str, wiring: Wiring, axes: Mapping[str, ChannelPair]
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Return the channel and the axis of each input, and of each output of a device."""
    measured, driven = [], []
    for place, (axis, pair) in enumerate(axes.items()):
        if pair.sensor == device:
            measured.append((wiring.inputs.index(pair.input or axis), place))
        if pair.amplifier == device:
            driven.append((wiring.outputs.index(pair.output or axis), place))
    return measured, driven


def _measuring(
    name: str, sensor: Sensor, wiring: Wiring, axes: Mapping[str, ChannelPair]
) -> _Measuring:
    """Sort the inputs of a device: what need not be calibrated costs nothing in the loop."""
    role = _Measuring(sensor, [], [], [])
    for place, (axis, pair) in enumerate(axes.items()):
        if pair.sensor == name:
            one = CalibratedInput(wiring, pair.input or axis, pair.to_um, pair.light)
            if one.plain_place is None:
                role.calibrated.append((one, place))
            else:
                role.plain.append((one.plain_place, place))
        command = pair.command
        if command is not None and command.device == name:
            channel = command.channel or axis
            one = CalibratedInput(wiring, channel, command.calibration, command.light)
            role.commanding.append((one, place))
    return role


def _wrong_role(name: str, role: str) -> DeviceError:
    return DeviceError(f"device {name} is no {role}; name another for this axis")
