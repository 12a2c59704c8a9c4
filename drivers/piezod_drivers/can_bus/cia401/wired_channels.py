"""The channels in use: their values as words of process data, and words as values."""

from collections.abc import Sequence

from piezod.devices.interface import Wiring
from piezod.devices.status import NO_FLAGS, SATURATED, Flags
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.cia401.codec import Scale
from piezod_drivers.can_bus.cia401.options import Cia401Options, NodeInput


class WiredChannels:
    """Converts between values of the channels in use and their words.

    Attributes:
        inputs: Number of each input on the node.
        outputs: Number of each output on the node.
        ranges: Lowest and highest value of each output, in its unit.
        safe_codes: Number and safe code of each output that has one.
        reads_only: Whether the node has outputs, and none of them is in use.
        read_by_sdo: Index of the object, and numbers, of the channels that the loop reads by SDO.
        input_flags: Flags of each input since the last call of `measured`.
    """

    def __init__(self, options: Cia401Options, wiring: Wiring) -> None:
        inputs = [options.inputs[name] for name in wiring.inputs]
        outputs = [options.outputs[name] for name in wiring.outputs]
        self.inputs = [channel.number for channel in inputs]
        self.outputs = [channel.number for channel in outputs]
        self.ranges = [channel.range for channel in outputs]
        self.safe_codes = [(c.number, c.safe_code) for c in outputs if c.safe_code is not None]
        self.reads_only = bool(options.outputs) and not outputs
        self.read_by_sdo = [(objects.INPUT, self.inputs)] if self.reads_only else []
        if options.read_back == "sdo":
            self.read_by_sdo.append((objects.OUTPUT, self.outputs))
        self.input_flags: list[Flags] = []
        self._input_scales = [_scale(channel) for channel in inputs]
        self._output_scales = [_scale(channel) for channel in outputs]

    def forget(self) -> None:
        """Forget the flags of the inputs."""
        self.input_flags = [NO_FLAGS] * len(self.inputs)

    def measured(self, words: Sequence[int]) -> list[float]:
        """Return the value of each input, and set `input_flags`. Real-time safe."""
        values: list[float] = []
        flags: list[Flags] = []
        for scale, word in zip(self._input_scales, words, strict=True):
            value, is_at_an_end = scale.read(word)
            values.append(value)
            flags.append(SATURATED if is_at_an_end else NO_FLAGS)
        self.input_flags = flags
        return values

    def in_force(self, words: Sequence[int]) -> list[float]:
        """Return the value of each output. Real-time safe."""
        return [s.value_of(word) for s, word in zip(self._output_scales, words, strict=True)]

    def words_of(self, values: Sequence[float]) -> list[int]:
        """Return the word of each output for a value within its range. Real-time safe."""
        return [s.word_of(value) for s, value in zip(self._output_scales, values, strict=True)]


def _scale(channel: NodeInput) -> Scale:
    return Scale((channel.code_at_min, channel.code_at_max), channel.range)
