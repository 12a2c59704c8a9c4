"""The roles that a device plays for the axes of a stage: which channel serves which axis."""

from collections.abc import Mapping
from typing import NamedTuple

from piezod.devices.inputs import CalibratedInput
from piezod.devices.interface import Amplifier, Sensor, Wiring
from piezod.devices.outputs import CalibratedOutput
from piezod.devices.wiring import ChannelPair
from piezod.errors import DeviceError


class SensorRole(NamedTuple):
    """A device that is read."""

    sensor: Sensor  #: The device.
    plain: list[tuple[int, int]]  #: Input and axis of each displacement that is in µm already.
    #: Input and axis of each displacement that must be calibrated.
    calibrated: list[tuple[CalibratedInput, int]]
    commanding: list[tuple[CalibratedInput, int]]  #: Input and axis of each command input.
    lines: list[tuple[int, int]]  #: Input and line of each digital input.


class AmplifierRole(NamedTuple):
    """A device that is driven."""

    amplifier: Amplifier  #: The device.
    axes: list[int]  #: Axis of each of its outputs.
    outputs: list[CalibratedOutput]  #: Calibrated outputs, in that order.
    lines: list[int]  #: Line of each of its other outputs, which follow.


def places(
    device: str, wiring: Wiring, axes: Mapping[str, ChannelPair]
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Return (channel, axis) of each input, and of each output, of a device."""
    measured, driven = [], []
    for place, (axis, pair) in enumerate(axes.items()):
        if pair.sensor == device:
            measured.append((wiring.inputs.index(pair.input or axis), place))
        if pair.amplifier == device:
            driven.append((wiring.outputs.index(pair.output or axis), place))
    return measured, driven


def sensor_role(
    name: str, sensor: Sensor, wiring: Wiring, axes: Mapping[str, ChannelPair]
) -> SensorRole:
    """Sort the inputs of a device: an input without calibration costs nothing in the loop."""
    role = SensorRole(sensor, [], [], [], [])
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


def wrong_role(name: str, role: str) -> DeviceError:
    """Return the error for a device that cannot play a role."""
    return DeviceError(f"device {name} is no {role}: name another device for this axis")
