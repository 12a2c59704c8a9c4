"""Emulated Thorlabs cubes and their drivers, in virtual time."""

from collections.abc import Callable

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.amplifier_dialogue import AmplifierDialogue
from piezod_drivers.serial_line.thorlabs_apt.codec import HOST, UNIT
from piezod_drivers.serial_line.thorlabs_apt.emulator import KpzEmulator, KsgEmulator
from piezod_drivers.serial_line.thorlabs_apt.options import AptOptions
from piezod_drivers.serial_line.thorlabs_apt.reader_dialogue import ReaderDialogue
from tests.drivers.serial_line.linear_rig import LinearRig, bench
from tests.drivers.serial_line.scripted_line import EmulatedLine

NOW = 5


OUTPUT, INPUT = Wiring((), ("1",)), Wiring(("1",), ())


def kpz(**options: object) -> tuple[BusDevice, EmulatedLine, LinearRig, KpzEmulator]:
    """Return an amplifier, the line to it, the rig and the emulator."""
    stand, rig, time = bench()
    emulator = KpzEmulator(stand, "")
    line = EmulatedLine(emulator, time)
    configured = AptOptions.model_validate({"port": "p", "model": "KPZ101", **options})
    return BusDevice("KPZ101", AmplifierDialogue(configured, OUTPUT, line)), line, rig, emulator


def ksg(**options: object) -> tuple[BusDevice, EmulatedLine, LinearRig, KsgEmulator]:
    """Return a strain gauge reader, the line to it, the rig behind it and the emulator."""
    stand, rig, time = bench()
    emulator = KsgEmulator(stand, "")
    line = EmulatedLine(emulator, time)
    configured = AptOptions.model_validate({"port": "p", "model": "KSG101", **options})
    return BusDevice("KSG101", ReaderDialogue(configured, INPUT, line)), line, rig, emulator


def show(emulator: KsgEmulator, mode: int) -> None:
    """Let an emulated reader show another quantity."""
    emulator.receive(codec.long(codec.Id.SET_GAUGE_IO, codec.pack_gauge_io(1, mode)))


def instead(ident: int, answer: bytes) -> Callable[[bytes], bytes]:
    """Return a function that replaces replies of a kind by another reply."""
    return lambda reply: answer if codec.ident_of(reply) == ident else reply


def answering(ident: int, value: int) -> Callable[[bytes], bytes]:
    """Return a function that replaces the parameter in replies of a kind."""
    return instead(ident, codec.short(ident, 1, value, to=HOST, source=UNIT))


def answering_words(ident: int, channel: int, *values: int) -> Callable[[bytes], bytes]:
    """Return a function that replaces the numbers of a channel in replies of a kind."""
    answer = codec.long(ident, codec.words(channel, *values), to=HOST, source=UNIT)
    return instead(ident, answer)
