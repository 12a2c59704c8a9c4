"""The calls of the loop on a converter of IIO: a read or a write of a file for each channel."""

from collections.abc import Sequence
from math import nan
from pathlib import Path
from typing import Final, NamedTuple

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.dialogue import Reading
from piezod.devices.interface import UNKNOWN, Capabilities, Identity, Wiring
from piezod.errors import DeviceError
from piezod_drivers.kernel.iio.options import IioInput, IioOptions, IioOutput, unit_of
from piezod_drivers.kernel.iio.sysfs import RawFile, folder_of, name_of, number_in

MAX_RATE_HZ: Final = 1000.0
"""A transfer on SPI at 1 MHz takes some 50 µs with its system call; on I²C at 400 kHz, 150 µs."""


class Channel(NamedTuple):
    """A channel of an open device: value = scale · (raw + offset)."""

    file: RawFile  #: File with its raw value.
    scale: float  #: Value of a raw step, in the unit of the channel.
    offset: float  #: Raw value of 0, with the other sign.
    raw: tuple[int, int] | None  #: Lowest and highest raw value; None if they are not known.

    def value(self, raw: int) -> float:
        """Return the value of a raw value. Real-time safe."""
        return self.scale * (raw + self.offset)

    def sample(self) -> float:
        """Read the value; NaN at an end of the range. Real-time safe."""
        raw, ends = self.file.read(), self.raw
        return self.value(raw) if ends is None or ends[0] < raw < ends[1] else nan

    def put(self, value: float) -> None:
        """Set the value, within the range. Real-time safe."""
        raw = round(value / self.scale - self.offset)
        self.file.write(raw if self.raw is None else min(max(raw, self.raw[0]), self.raw[1]))


class IioDialogue(BaseDialogue):
    """Implements `Dialogue` for a converter of IIO; its outputs hold when it is closed."""

    def __init__(self, options: IioOptions, wiring: Wiring) -> None:
        super().__init__(wiring, self, None)
        self._options = options
        self._folder = Path()
        self._inputs: list[Channel] = []
        self._outputs: list[Channel] = []

    def open(self) -> Identity:
        """Find the device and open its files; its outputs stay as they are.

        Raises:
            DeviceUnavailableError: If it is absent or not allowed.
            DeviceError: If a channel has no scale, or an output is powered down.
            LineFault: If the kernel refuses.
        """
        options, wiring = self._options, self._wiring
        self.close()
        folder = self._folder = folder_of(options.device)
        for name in wiring.inputs:
            self._inputs.append(self._channel(options.inputs[name], writes=False))
        for name in wiring.outputs:
            self._outputs.append(self._channel(options.outputs[name], writes=True))
        for channel in self._outputs:
            channel.file.read()  # each driver of an output that can be controlled has it
        self._ranges = [_range_of(channel) for channel in self._outputs]
        self._forget_in_force()
        return Identity("IIO", name_of(folder), UNKNOWN, UNKNOWN)

    def close(self) -> None:
        """Close the files; the outputs hold. Never raises."""
        for channel in (*self._inputs, *self._outputs):
            channel.file.close()
        self._inputs, self._outputs = [], []

    def capabilities(self) -> Capabilities:
        """Return the channels and the rate; outputs are read back from the kernel's driver."""
        return Capabilities(*self._wiring, read_back=True, max_rate_hz=MAX_RATE_HZ, holds=True)

    def activate(self) -> None:
        """Check that the outputs are not powered down; they keep their values.

        Raises:
            DeviceError: If one is: it would jump to its value as soon as it is powered.
        """
        for name in self._wiring.outputs:
            file = self._options.outputs[name].file
            if number_in(self._folder, file, "powerdown"):
                path = self._folder / f"{file}_powerdown"
                raise DeviceError(
                    f"output {name} is powered down: set {file}_raw to the value at rest, then "
                    f"write 0 to {path}"
                )

    def sample(self, now_ns: int) -> Reading:
        """Read every input. Real-time safe."""
        values = [channel.sample() for channel in self._inputs]
        self._flag_saturated(values)
        return now_ns, values

    def put(self, values: Sequence[float]) -> None:
        """Set every output. Real-time safe."""
        for channel, value in zip(self._outputs, values, strict=True):
            channel.put(value)
        self._forget_in_force()

    def _ask_in_force(self) -> Sequence[float]:
        return [channel.value(channel.file.read()) for channel in self._outputs]

    def _channel(self, options: IioInput | IioOutput, *, writes: bool) -> Channel:
        folder, file = self._folder, options.file
        unit, size = unit_of(file)
        scale = options.scale
        if scale is None:
            told = number_in(folder, file, "scale")
            scale = None if told is None else told * size
        if not scale:
            raise DeviceError(
                f"{folder} tells no scale of {file}: give `scale`, the {unit} of a raw step"
            )
        offset = number_in(folder, file, "offset") or 0.0
        return Channel(RawFile(folder / f"{file}_raw", writes=writes), scale, offset, options.raw)


def _range_of(channel: Channel) -> tuple[float, float]:
    assert channel.raw is not None  # noqa: S101 - an output has one
    low, high = sorted(map(channel.value, channel.raw))
    return low, high
