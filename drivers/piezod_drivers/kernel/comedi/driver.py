"""The driver `comedi`: converter cards that a comedi driver of the kernel drives."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.interface import DriverPlugin, Wiring, faults
from piezod_drivers.kernel.comedi.card import Card
from piezod_drivers.kernel.comedi.comedi_card import ComediCard
from piezod_drivers.kernel.comedi.dialogue import ComediDialogue
from piezod_drivers.kernel.comedi.options import ComediOptions, channels
from piezod_drivers.kernel.comedi.player import ComediPlayer


def make_device(options: ComediOptions, wiring: Wiring, card: Card) -> BusDevice:
    """Construct the device; nothing is opened.

    It plays if each output in use is measured by an input: after a stop in the middle of a play
    only a measurement knows the voltage. It does not while the loop has digital lines of it.
    """
    dialogue = ComediDialogue(options, wiring, card)
    has_lines = any(name in options.digital_inputs for name in wiring.inputs)
    outputs = [options.outputs.get(name) for name in wiring.outputs]
    plays = not has_lines and all(one is not None and one.measured_by for one in outputs)
    if outputs and plays:
        return PlayingBusDevice("converter card", dialogue, ComediPlayer(dialogue))
    return BusDevice("converter card", dialogue)


def _create(options: ComediOptions, wiring: Wiring, _seed: int) -> BusDevice:
    return make_device(options, wiring, ComediCard(options.port))


PLUGIN: Final = DriverPlugin(
    name="comedi",
    summary="converter cards by the kernel's comedi drivers: NI, Measurement Computing, ADLINK, "
    "Advantech",
    options_model=ComediOptions,
    create=_create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=faults("A1 A3 A12 B1 B10 B14 S7 S10"),
)
