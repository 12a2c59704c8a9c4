"""The messages and signals of a configuration that a wiring uses."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.devices.interface import Wiring
from piezod.errors import DeviceError
from piezod_drivers.can_bus.dbc.codec import DbcMessage, SignalReader
from piezod_drivers.can_bus.dbc.messages import Checksum, ReceivedMessage, SentMessage
from piezod_drivers.can_bus.dbc.options import DbcOptions, SignalPlace, flag_of, messages_of

_SLACK: Final = 0.01
"""Largest excess of a read-back value over its range, as a fraction of the range."""


class HeldOutput(NamedTuple):
    """An output that no axis uses, but that the message of a used output also sets.

    It is sent with the value that was read back.
    """

    name: str  #: Name of the output.
    target: tuple[int, str]  #: Identifier of its message, and its signal.
    #: Identifier of the message that reads it back, and the reader.
    read_back: tuple[int, SignalReader]
    range: tuple[float, float]  #: Lowest and highest value that it can be set to.

    def held_value(self, value: float) -> float:
        """Return the value to send so that the output stays as it was read back.

        Raises:
            DeviceError: If this value is out of range.
        """
        low, high = self.range
        # A measured value may lie slightly beyond the range that can be set.
        slack = _SLACK * (high - low)
        if not low - slack <= value <= high + slack:
            raise DeviceError(
                f"output {self.name}, which no axis uses, is set by the same message and cannot "
                f"be held: it reads back {value:g}, allowed range {low:g} to {high:g}"
            )
        return min(max(value, low), high)


class UsedSignals:
    """The messages and signals of a configuration that a wiring uses.

    Raises:
        DeviceError: If a message in use also sets an output that is neither used nor read back.
    """

    def __init__(self, options: DbcOptions, wiring: Wiring) -> None:
        self._options, self._messages = options, messages_of(options)
        outputs = [options.outputs[name] for name in wiring.outputs]
        self.held_outputs = self._find_held_outputs(wiring.outputs)
        read_backs = [output.read_back for output in outputs]
        self.driven_signals = [(self._message(output).id, output.signal) for output in outputs]
        # Each message once, in the order of the outputs: several outputs may share a message.
        self.driven_messages = tuple(
            dict.fromkeys(identifier for identifier, _ in self.driven_signals)
        )
        self.ranges = [self._message(one).signals[one.signal].range for one in outputs]
        self.inputs = [self._place(options.inputs[name]) for name in wiring.inputs]
        self.read_backs = [each if each is None else self._place(each) for each in read_backs]
        # A digital output need not be read back; it is a line of the loop.
        asked = [
            place is not None
            for output, place in zip(outputs, self.read_backs, strict=True)
            if place is not None or self._message(output).signals[output.signal].bits > 1
        ]
        self.reads_back = bool(asked) and all(asked)
        self.flags = [(flag_of(name), *self._place(one)) for name, one in options.flags.items()]
        sent = {output.message for output in outputs} | {options.request} - {None}
        self.sent = {self._messages[name].id: self._make_sent(name) for name in sent if name}
        self.request = None if options.request is None else self._messages[options.request].id
        for identifier, signal in (
            *self.driven_signals,
            *(held.target for held in self.held_outputs),
        ):
            self.sent[identifier].prepare(signal)
        held_outputs = [fill.read_back for fill in self.held_outputs]
        told = [place for place in self.read_backs if place is not None]
        needed = [identifier for identifier, _ in (*self.inputs, *told, *held_outputs)]
        self.answers = frozenset(needed)
        # Flags are read if they come, but nothing waits for them.
        received = self.answers | {identifier for _, identifier, _ in self.flags}
        self.received = {
            one.id: self._make_received(one)
            for one in self._messages.values()
            if one.id in received
        }
        # A reply without an echo could be the late reply to an earlier request.
        self.tagged = bool(self.answers) and all(
            one.name in options.echoes for one in self._messages.values() if one.id in self.answers
        )

    @property
    def sizes(self) -> list[int]:
        """Number of data bytes of each frame of a cycle."""
        used = {*self.sent, *self.answers}
        return [one.n_bytes for one in self._messages.values() if one.id in used]

    def _find_held_outputs(self, used: Sequence[str]) -> list[HeldOutput]:
        """Return the unused outputs in the messages of the used ones."""
        outputs = self._options.outputs
        driven = {(self._message(outputs[name]).id, outputs[name].signal) for name in used}
        sent = {identifier for identifier, _ in driven}
        held_outputs = []
        for name, output in outputs.items():
            message = self._message(output)
            target = message.id, output.signal
            # Only messages that are sent anyway can change an unused output.
            if message.id not in sent or target in driven:
                continue
            if output.read_back is None:
                raise DeviceError(
                    f"{message.name} also sets output {name}, which no axis uses and which has no "
                    f"read_back: give it one, or use it together with {', '.join(used)}"
                )
            read_back, range_ = self._place(output.read_back), message.signals[output.signal].range
            held_outputs.append(HeldOutput(name, target, read_back, range_))
        return held_outputs

    def _message(self, place: SignalPlace) -> DbcMessage:
        return self._messages[place.message]

    def _place(self, place: SignalPlace) -> tuple[int, SignalReader]:
        message = self._message(place)
        return message.id, SignalReader(message, place.signal)

    def _checksum(self, message: DbcMessage) -> Checksum | None:
        place = self._options.checksums.get(message.name)
        return None if place is None else Checksum(message, place.signal, place.algorithm)

    def _make_sent(self, name: str) -> SentMessage:
        message, options = self._messages[name], self._options
        constants = options.constants.get(name, {})
        return SentMessage(message, constants, options.counters.get(name), self._checksum(message))

    def _make_received(self, message: DbcMessage) -> ReceivedMessage:
        options, name = self._options, message.name
        counter, echo = options.counters.get(name), options.echoes.get(name)
        return ReceivedMessage(message, counter, echo, self._checksum(message))
