"""The channels of all axes as one sensor and one amplifier, a transaction per device and cycle."""

from collections.abc import Mapping, Sequence
from math import nan
from typing import NamedTuple

from piezod.config.axes import AxisConfig
from piezod.config.devices import DeviceConfig
from piezod.devices import registry
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
from piezod.devices.status import NO_FLAGS, Flags, TellsStatus
from piezod.errors import DeviceError


class ChannelPair(NamedTuple):
    """Which channels serve an axis.

    Attributes:
        sensor: Name of the device that measures it.
        amplifier: Name of the device that drives it.
        input: Name of the sensor's channel, None for the name of the axis.
        output: Name of the amplifier's channel, None for the name of the axis.
    """

    sensor: str
    amplifier: str
    input: str | None = None
    output: str | None = None


def pairs_of(axes: Mapping[str, AxisConfig]) -> dict[str, ChannelPair]:
    """Return the channels of each axis of a configuration."""
    return {
        name: ChannelPair(
            axis.sensor.device,
            axis.amplifier.device,
            axis.sensor.channel,
            axis.amplifier.channel,
        )
        for name, axis in axes.items()
    }


def wiring_of(device: str, axes: Mapping[str, ChannelPair]) -> Wiring:
    """Return the channels of a device that axes use, in the order of the axes."""
    inputs = (pair.input or axis for axis, pair in axes.items() if pair.sensor == device)
    outputs = (pair.output or axis for axis, pair in axes.items() if pair.amplifier == device)
    return Wiring(tuple(dict.fromkeys(inputs)), tuple(dict.fromkeys(outputs)))


def construct(
    devices: Mapping[str, DeviceConfig], axes: Mapping[str, ChannelPair], seed: int
) -> dict[str, Device]:
    """Construct devices, each for its `wiring_of`; nothing is opened.

    Raises:
        RegistryError: If a driver cannot be loaded.
    """
    return {
        name: registry.load(device.driver).create(device.options, wiring_of(name, axes), seed)
        for name, device in devices.items()
    }


class Channels:
    """Implements `Sensor`, `Amplifier`, `KnowsTruth` and `TellsStatus` for all axes.

    Args:
        devices: Constructed devices by name, each for its `wiring_of`.
        axes: The channels of each axis; their order is that of every sequence.

    Raises:
        DeviceError: If a device cannot play a role that an axis gives it.
    """

    def __init__(self, devices: Mapping[str, Device], axes: Mapping[str, ChannelPair]) -> None:
        self._devices = devices
        self._axes = tuple(axes)
        self._sensors: list[tuple[Sensor, list[tuple[int, int]]]] = []
        self._amplifiers: list[tuple[Amplifier, list[int]]] = []
        self._truths: list[tuple[KnowsTruth, list[tuple[int, int]]]] = []
        self._tellers: list[tuple[TellsStatus, list[tuple[int, int]]]] = []
        for name, device in devices.items():
            wiring = wiring_of(name, axes)
            measured, driven = _places(name, wiring, axes)
            if measured:
                if not isinstance(device, Sensor):
                    raise _wrong_role(name, "sensor")
                self._sensors.append((device, measured))
                if isinstance(device, KnowsTruth):
                    self._truths.append((device, measured))
            if driven:
                if not isinstance(device, Amplifier):
                    raise _wrong_role(name, "amplifier")
                self._amplifiers.append((device, [axis for _, axis in driven]))
            if isinstance(device, TellsStatus):
                after_inputs = len(wiring.inputs)
                outputs = [(after_inputs + channel, axis) for channel, axis in driven]
                self._tellers.append((device, measured + outputs))
        self._zero_um = [0.0] * len(axes)
        self._true_zero_um = [0.0] * len(axes)
        self._no_flags = [NO_FLAGS] * len(axes)

    def open(self) -> Identity:
        """Open every device; if one cannot be, those before it are closed again."""
        identities = []
        try:
            for device in self._devices.values():
                identities.append(device.open())
        except DeviceError:
            self.close()
            raise
        return Identity(*(" + ".join(parts) for parts in zip(*identities, strict=True)))

    def capabilities(self) -> Capabilities:
        """Tell what all devices can do together."""
        each = [device.capabilities() for device in self._devices.values()]
        return Capabilities(
            self._axes,
            self._axes,
            all(one.read_back for one in each),
            min(one.max_rate_hz for one in each),
            any(one.holds for one in each),
            all(one.opens_relaxed for one in each),
        )

    def activate(self, now_ns: int) -> None:
        """Make every device ready for cyclic calls."""
        for device in self._devices.values():
            device.activate(now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Bring the outputs of every device to rest."""
        for device in self._devices.values():
            device.deactivate(now_ns)

    def close(self) -> None:
        """Make the outputs of every device safe and let go of it."""
        for device in self._devices.values():
            device.close()

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
        for sensor, measured in self._sensors:
            taken = sensor.read(now_ns)
            for channel, axis in measured:
                t_ns, position_um, valid = taken[channel]
                samples[axis] = Sample(t_ns, position_um - self._zero_um[axis], valid)
        return samples

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
        for amplifier, driven in self._amplifiers:
            taken &= amplifier.write([drive_v[axis] for axis in driven], now_ns)
        return taken

    def read_back(self, now_ns: int) -> list[float]:
        """Tell the voltage now in force, in V, per axis; may be called in the loop."""
        drive_v = [nan] * len(self._axes)
        for amplifier, driven in self._amplifiers:
            for axis, value in zip(driven, amplifier.read_back(now_ns), strict=True):
                drive_v[axis] = value
        return drive_v

    def status(self, now_ns: int) -> list[Flags]:
        """Tell what is the matter with each axis, in either role; may be called in the loop.

        Nothing is where a device does not tell its status.
        """
        if not self._tellers:
            return self._no_flags
        flags = self._no_flags.copy()
        for device, served in self._tellers:
            told = device.status(now_ns)
            for channel, axis in served:
                flags[axis] |= told[channel]
        return flags


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


def _wrong_role(name: str, role: str) -> DeviceError:
    return DeviceError(f"device {name} is no {role}; name another for this axis")
