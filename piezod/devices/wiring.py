"""The channels of each axis, and the resulting wiring of each device."""

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Final, NamedTuple, TypeAlias

from piezod.config.axes import AxisConfig
from piezod.config.channels import Calibration, InputConfig, LightConfig, LineCalibration
from piezod.config.devices import DeviceConfig
from piezod.config.lines import LineConfig
from piezod.devices import registry
from piezod.devices.interface import Device, Wiring


class ChannelPair(NamedTuple):
    """Channels that serve an axis."""

    sensor: str | None  #: Name of the device that measures it; None without a sensor.
    amplifier: str  #: Name of the device that drives it.
    input: str | None = None  #: Name of the sensor's channel; None for the name of the axis.
    output: str | None = None  #: Name of the amplifier's channel; None for the name of the axis.
    to_um: Calibration = LineCalibration()  #: Calibration of the input.
    to_v: Calibration = LineCalibration()  #: Calibration of the output.
    light: LightConfig | None = None  #: Channel of the input's light; None if there is none.
    command: InputConfig | None = None  #: Input that commands the axis; None if there is none.
    beside: tuple[str, ...] = ()  #: Inputs of the sensor's device that a scan records beside.

    def inputs_of(self, device: str, axis: str) -> Iterator[str]:
        """Yield the inputs of a device that the axis of this name uses."""
        if self.sensor == device:
            yield self.input or axis
            if self.light is not None:
                yield self.light.channel
            yield from self.beside
        if self.command is not None and self.command.device == device:
            yield self.command.channel or axis
            if self.command.light is not None:
                yield self.command.light.channel


def pairs_of(axes: Mapping[str, AxisConfig]) -> dict[str, ChannelPair]:
    """Return the channels of each axis of a configuration."""
    return {name: _pair_of(axis) for name, axis in axes.items()}


def _pair_of(axis: AxisConfig) -> ChannelPair:
    sensor, amplifier = axis.sensor, axis.amplifier
    driven = ChannelPair(
        None,
        amplifier.device,
        output=amplifier.channel,
        to_v=amplifier.calibration,
        command=axis.command_input,
    )
    if sensor is None:
        return driven
    return driven._replace(
        sensor=sensor.device,
        input=sensor.channel,
        to_um=sensor.calibration,
        light=sensor.light,
        beside=sensor.beside,
    )


Lines: TypeAlias = Mapping[str, LineConfig]
"""The lines of the loop by name."""
NO_LINES: Final[Lines] = {}


def wiring_of(device: str, axes: Mapping[str, ChannelPair], lines: Lines = NO_LINES) -> Wiring:
    """Return the channels of a device that axes use, in their order, then those of lines."""
    own = [line for line in lines.values() if line.device == device]
    inputs = chain.from_iterable(pair.inputs_of(device, axis) for axis, pair in axes.items())
    outputs = (pair.output or axis for axis, pair in axes.items() if pair.amplifier == device)
    # A dict removes duplicates and keeps the order: several axes may use the same light channel.
    return Wiring(
        tuple(dict.fromkeys(chain(inputs, (line.input for line in own if line.input)))),
        tuple(dict.fromkeys(chain(outputs, (line.output for line in own if line.output)))),
    )


def construct(
    devices: Mapping[str, DeviceConfig],
    axes: Mapping[str, ChannelPair],
    seed: int,
    lines: Lines = NO_LINES,
) -> dict[str, Device]:
    """Construct devices, each for its `wiring_of`; nothing is opened.

    Raises:
        RegistryError: If a driver cannot be loaded.
    """
    return {
        name: registry.load(device.driver).create(
            device.options, wiring_of(name, axes, lines), seed
        )
        for name, device in devices.items()
    }
