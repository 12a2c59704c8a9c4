"""The driver `psj`: amplifiers of piezosystem jena."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.bus.line import Line
from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.interface import ChannelUnits, DriverPlugin, Wiring, faults
from piezod.devices.player import AtEnd
from piezod_drivers.serial_line.options import make_line
from piezod_drivers.serial_line.psj.dialogue import PsjDialogue
from piezod_drivers.serial_line.psj.options import PsjOptions
from piezod_drivers.serial_line.psj.profiles import channel_names


def _channels(options: PsjOptions) -> ChannelUnits:
    profile = options.configured_profile()
    names = channel_names(profile)
    inputs = dict.fromkeys(names, "µm") if profile.reads == "position" else {}
    return ChannelUnits(inputs, dict.fromkeys(names, "V"))


def make_device(line: Line, options: PsjOptions, wiring: Wiring) -> BusDevice:
    """Construct an amplifier on a line; an NV200/D plays if it drives anything."""
    profile = options.configured_profile()
    dialogue = PsjDialogue(
        line,
        profile,
        wiring,
        options.range_v,
        options.timeout_ms * 1e-3,
        remote=options.remote,
        at_end=AtEnd(options.wave_end),
    )
    if dialogue.player is not None:
        return PlayingBusDevice(profile.title, dialogue, dialogue.player)
    return BusDevice(profile.title, dialogue)


def _create(options: PsjOptions, wiring: Wiring, _seed: int) -> BusDevice:
    line = make_line(options, options.configured_profile().baud)
    return make_device(line, options, wiring)


PLUGIN: Final = DriverPlugin(
    name="psj",
    summary="piezosystem jena: d-Drive, 30DV50/300, NV40/3 (CLE), NV40/1 CL, NV200/D",
    options_model=PsjOptions,
    create=_create,
    confirmed_on_hardware=False,
    channels=_channels,
    sees=faults("A1 A2 A3 A4 A8 A11 A12 A13 B1 B2 B3 B5 B6 B7 B10 B13 B14 S6 S10"),
)
