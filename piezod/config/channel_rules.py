"""Rules for devices and their channels: existence, units, and exclusive use."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

from piezod.config.channels import InputConfig, OutputConfig, SensorConfig
from piezod.config.document import KeyPath
from piezod.config.fields import BrokenRule, Drivers
from piezod.config.lines import LineConfig, broken_lines
from piezod.config.messages import show, suggest

if TYPE_CHECKING:
    from piezod.config.axes import AxisConfig
    from piezod.config.devices import DeviceConfig

_ROLE: Final = {True: "output", False: "input"}
_PHYSICAL: Final = {True: ("V", "V at the actuator"), False: ("µm", "µm")}


def broken_devices(
    devices: Mapping[str, "DeviceConfig"],
    axes: Mapping[str, "AxisConfig"],
    drivers: Drivers | None,
    lines: Mapping[str, LineConfig] | None = None,
) -> Iterator[BrokenRule]:
    """Yield the errors of devices and channels that do not exist or cannot be used as configured.

    Args:
        devices: The devices by name.
        axes: The axes by name.
        drivers: Drivers, which list the channels of their devices; None if they are not available.
        lines: The lines of the loop by name.
    """
    known, lines = list(devices), lines or {}
    for name, axis in axes.items():
        for role, channel in axis.channels():
            path = ("axes", name, role)
            if channel.device not in known:
                got = show(channel.device)
                what = f"no such device (got {got}), {suggest(channel.device, known, 'known')}"
                yield (*path, "device"), what
            elif drivers is not None:
                yield from _broken_channel(path, name, channel, devices[channel.device], drivers)
    driven = {
        (axis.amplifier.device, axis.amplifier.channel or name): f"axis {name}"
        for name, axis in axes.items()
    }
    yield from broken_lines(lines, devices, driven, drivers)
    yield from _driven_twice(axes)
    yield from _same_port(devices)
    used = {channel.device for axis in axes.values() for _, channel in axis.channels()}
    used |= {line.device for line in lines.values()}
    for name in known:
        if name not in used:
            yield ("devices", name), "no axis uses this device, leave it out or name it in an axis"


def _same_port(devices: Mapping[str, "DeviceConfig"]) -> Iterator[BrokenRule]:
    """Yield devices with the port of another device: a port can be opened only once."""
    held: dict[str, str] = {}
    for name, device in devices.items():
        port = getattr(device.options, "port", None)
        if not isinstance(port, str):
            continue
        if port in held:
            what = f"{show(port)} is the port of device {held[port]} too; each needs its own"
            yield ("devices", name, "options", "port"), what
        held[port] = name


def _broken_channel(
    path: KeyPath,
    axis: str,
    channel: OutputConfig | InputConfig,
    device: "DeviceConfig",
    drivers: Drivers,
) -> Iterator[BrokenRule]:
    has = drivers.load(device.driver).channels(device.options)
    if has is None:  # the driver accepts any name
        return
    drives = isinstance(channel, OutputConfig)
    units = has.outputs if drives else has.inputs
    name = channel.channel or axis
    if name in units:
        yield from _uncalibrated(path, channel, units[name], drives=drives)
    else:
        yield (*path, "channel"), _no_such(_ROLE[drives], name, channel, units)
    light = None if isinstance(channel, OutputConfig) else channel.light  # of an input only
    if light is not None and light.channel not in has.inputs:
        what = _no_such("input", light.channel, channel, has.inputs)
        yield (*path, "light", "channel"), what
    beside = channel.beside if isinstance(channel, SensorConfig) else ()
    for index, other in enumerate(beside):
        if other not in has.inputs:
            yield (*path, "beside", index), _no_such("input", other, channel, has.inputs)


def _no_such(
    role: str, name: str, channel: OutputConfig | InputConfig, units: Mapping[str, str]
) -> str:
    if not units:
        return f"device {channel.device} has no {role}s: name another device"
    return f"no such {role} (got {show(name)}), {suggest(name, list(units), 'known')}"


def _uncalibrated(
    path: KeyPath, channel: OutputConfig | InputConfig, unit: str, *, drives: bool
) -> Iterator[BrokenRule]:
    """Yield an error if a unit needs a calibration and the file has none.

    A calibration in the file is intended, even if it changes nothing.
    """
    symbol, physical = _PHYSICAL[drives]
    if unit != symbol and "calibration" not in channel.model_fields_set:
        direction = f"from {unit} to {physical}"
        yield (
            path,
            f"{_ROLE[drives]} {channel.channel or path[1]} of {channel.device} is in {unit}: "
            f"give a `calibration:` {direction}",
        )


def _driven_twice(axes: Mapping[str, "AxisConfig"]) -> Iterator[BrokenRule]:
    drivers: dict[tuple[str, str], str] = {}
    for name, axis in axes.items():
        output = axis.amplifier.device, axis.amplifier.channel or name
        first = drivers.setdefault(output, name)
        if first != name:
            what = f"output {output[1]} of {output[0]} drives axis {first} already"
            yield ("axes", name, "amplifier"), f"{what}: an axis needs one of its own"
