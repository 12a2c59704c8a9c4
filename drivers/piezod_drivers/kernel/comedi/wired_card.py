"""The channels in use of an open card, with their conversions."""

from collections.abc import Sequence
from typing import NamedTuple

from piezod.devices.interface import Wiring
from piezod.errors import DeviceError
from piezod_drivers.kernel.comedi import library as names
from piezod_drivers.kernel.comedi.card import Card, Pin
from piezod_drivers.kernel.comedi.codec import LEVEL, Converter
from piezod_drivers.kernel.comedi.options import REFERENCES, CardInput, CardLine, ComediOptions


class WiredPin(NamedTuple):
    """A channel with its conversion."""

    pin: Pin  #: The channel.
    converter: Converter  #: Its conversion.


class WiredCard(NamedTuple):
    """The channels in use of an open card."""

    card: Card  #: The card.
    inputs: Sequence[WiredPin]  #: Inputs, in the order of the wiring.
    outputs: Sequence[WiredPin]  #: Outputs, in the order of the wiring.
    #: Inputs that read back the outputs, in their order, of a digital output itself; none if an
    #: output has no such input.
    measuring: Sequence[WiredPin]

    def sample(self) -> list[float]:
        """Return the value of each input; NaN at an end of its range. Real-time safe."""
        return [converter.sample(self.card.read(pin)) for pin, converter in self.inputs]

    def put(self, values_v: Sequence[float]) -> None:
        """Set each output. Real-time safe."""
        for (pin, converter), value_v in zip(self.outputs, values_v, strict=True):
            self.card.write(pin, converter.code(value_v))

    def measured(self) -> list[float]:
        """Return the measured value of each output. Real-time safe."""
        return [converter.value(self.card.read(pin)) for pin, converter in self.measuring]

    def lines(self) -> tuple[list[Pin], list[Pin]]:
        """Return the digital outputs and inputs."""
        outputs, inputs = (
            [pin for pin, converter in side if converter is LEVEL]
            for side in (self.outputs, self.inputs)
        )
        return outputs, inputs


def wired(card: Card, options: ComediOptions, wiring: Wiring) -> WiredCard:
    """Find the channels in use of an open card.

    Raises:
        DeviceError: If the card lacks one of them.
        LineFault: If the kernel refuses.
    """

    def found(kind: int, channel: CardInput) -> WiredPin:
        subdevice = card.subdevice(kind)
        if subdevice < 0:
            what = "inputs" if kind == names.INPUTS else "outputs"
            raise DeviceError(f"{options.port} has no analogue {what}: name another card")
        reference = REFERENCES[channel.reference]
        pin = card.pin(subdevice, channel.number, channel.range, reference)
        return WiredPin(pin, card.converter(pin, options.calibration))

    def line(channel: CardLine, *, driven: bool) -> WiredPin:
        return WiredPin(card.line(channel.number, channel.subdevice, driven=driven), LEVEL)

    inputs, outputs, measuring = [], list[WiredPin](), list[WiredPin]()
    for name in wiring.inputs:
        if digital := options.digital_inputs.get(name):
            inputs.append(line(digital, driven=False))
        else:
            inputs.append(found(names.INPUTS, options.inputs[name]))
    for name in wiring.outputs:
        if digital := options.digital_outputs.get(name):
            outputs.append(line(digital, driven=True))
            measuring.append(outputs[-1])
            continue
        output = options.outputs[name]
        outputs.append(found(names.OUTPUTS, output))
        if output.measured_by is not None:
            measuring.append(found(names.INPUTS, output.measured_by))
    return WiredCard(card, inputs, outputs, measuring if len(measuring) == len(outputs) else [])
