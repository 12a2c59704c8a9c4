"""The calls of the loop on a converter card: one for each channel."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import UNKNOWN, Capabilities, Identity, Wiring
from piezod.devices.status import DeviceFlag
from piezod_drivers.kernel.comedi.card import Card
from piezod_drivers.kernel.comedi.options import ComediOptions
from piezod_drivers.kernel.comedi.wired_card import WiredCard, wired
from piezod_drivers.kernel.errno_faults import held

MAX_RATE_HZ: Final = 2000.0
"""A conversion and its system call take some 10 µs, with several channels ten times as long."""


class ComediDialogue(BaseDialogue):
    """Implements `Dialogue` for a converter card.

    The outputs hold when the card is closed. While they are under control they are locked: the
    kernel refuses other programs.
    """

    def __init__(self, options: ComediOptions, wiring: Wiring, card: Card) -> None:
        super().__init__(wiring, card, None)
        self._options, self._card = options, card
        self.wired = WiredCard(card, (), (), ())
        """The channels in use; set by `open`."""

    def open(self) -> Identity:
        """Open the card and find its channels; its outputs stay as they are.

        Raises:
            DeviceUnavailableError: If it is absent or not allowed.
            DeviceError: If it lacks a channel.
            LineFault: If the kernel refuses.
        """
        driver, board, version = self._card.open()
        self.wired = wired(self._card, self._options, self._wiring)
        self._ranges = [converter.range_v for _, converter in self.wired.outputs]
        self._forget_in_force()
        return Identity(driver, board, UNKNOWN, f"comedi {version}")

    def capabilities(self) -> Capabilities:
        """Return the channels, the rate, and whether the outputs are read back."""
        read_back = bool(self.wired.measuring)
        return Capabilities(*self._wiring, read_back, MAX_RATE_HZ, holds=True)

    def activate(self) -> None:
        """Lock the outputs, which keep their values; direct the lines.

        Raises:
            PortHeldError: If another program drives them.
            DeviceError: If a line cannot have the direction of its use.
            LineFault: If the kernel refuses.
        """
        for subdevice in self._driven():
            try:
                self._card.lock(subdevice)
            except LineFault as fault:
                if fault.flag is DeviceFlag.BUSY:
                    raise held(self._options.port) from fault
                raise
        self._card.direct(*self.wired.lines())

    def deactivate(self) -> None:
        """Unlock the outputs; they hold."""
        for subdevice in self._driven():
            self._card.unlock(subdevice)

    def sample(self, now_ns: int) -> Reading:
        """Read every input. Real-time safe."""
        values = self.wired.sample()
        self._flag_saturated(values)
        return now_ns, values

    def put(self, values: Sequence[float]) -> None:
        """Set every output. Real-time safe."""
        self.wired.put(values)
        self._forget_in_force()

    def _ask_in_force(self) -> Sequence[float]:
        return self.wired.measured()

    def _driven(self) -> set[int]:
        return {pin.subdevice for pin, _ in self.wired.outputs}
