"""Which frames and signals of a configuration are used."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.devices.interface import Wiring
from piezod.errors import DeviceError
from piezod_drivers.can_bus.dbc.codec import DbcMessage, SignalReader
from piezod_drivers.can_bus.dbc.messages import Checksum, Received, Sent
from piezod_drivers.can_bus.dbc.options import DbcOptions, SignalPlace, flag_of, messages_of

_SLACK: Final = 0.01
"""How far beyond its range an output may be read back, as a part of the range."""


class UnusedOutput(NamedTuple):
    """An output that nobody uses, in a message that sets others: it is sent as it was found.

    Attributes:
        name: Its name.
        place: Identifier of its message, and its signal.
        back: Where it is read back.
        range: Lowest and highest value that it can be set to.
    """

    name: str
    place: tuple[int, str]
    back: tuple[int, SignalReader]
    range: tuple[float, float]

    def held(self, value: float) -> float:
        """Return what it has to be set to, to stay where it was read back.

        Raises:
            DeviceError: If it cannot be set to that.
        """
        low, high = self.range
        slack = _SLACK * (high - low)
        if not low - slack <= value <= high + slack:
            raise DeviceError(
                f"output {self.name}, which no axis uses, is set by the same message, and cannot "
                f"be held: it reads back {value:g}, its range is {low:g} to {high:g}"
            )
        return min(max(value, low), high)


class UsedSignals:
    """The frames and signals of a configuration that a wiring uses.

    Args:
        options: What a configuration says.
        wiring: The channels that are used.

    Raises:
        DeviceError: If a message that drives has an output that is neither used nor read back.
    """

    def __init__(self, options: DbcOptions, wiring: Wiring) -> None:
        self._options, self._messages = options, messages_of(options)
        outputs = [options.outputs[name] for name in wiring.outputs]
        self.fills = self._find_fills(wiring.outputs)
        backs = [output.read_back for output in outputs]
        self.drives = [(self._message(output).id, output.signal) for output in outputs]
        self.driving = tuple(dict.fromkeys(identifier for identifier, _ in self.drives))
        self.ranges = [self._message(one).signals[one.signal].range for one in outputs]
        self.inputs = [self._place(options.inputs[name]) for name in wiring.inputs]
        self.backs = [self._place(back) for back in backs if back is not None]
        self.reads_back = bool(outputs) and len(self.backs) == len(outputs)
        self.flags = [(flag_of(name), *self._place(one)) for name, one in options.flags.items()]
        sent = {output.message for output in outputs} | {options.request} - {None}
        self.sent = {self._messages[name].id: self._make_sent(name) for name in sent if name}
        self.request = None if options.request is None else self._messages[options.request].id
        for identifier, signal in (*self.drives, *(fill.place for fill in self.fills)):
            self.sent[identifier].uses(signal)
        fills = [fill.back for fill in self.fills]
        needed = [identifier for identifier, _ in (*self.inputs, *self.backs, *fills)]
        self.answers = frozenset(needed)
        told = self.answers | {identifier for _, identifier, _ in self.flags}
        self.received = {
            one.id: self._make_received(one) for one in self._messages.values() if one.id in told
        }
        self.tagged = bool(self.answers) and all(
            one.name in options.echoes for one in self._messages.values() if one.id in self.answers
        )

    @property
    def sizes(self) -> list[int]:
        """Bytes of each frame of a cycle."""
        used = {*self.sent, *self.answers}
        return [one.n_bytes for one in self._messages.values() if one.id in used]

    def _find_fills(self, used: Sequence[str]) -> list[UnusedOutput]:
        """Find the outputs that nobody uses in the messages of those that are used."""
        outputs = self._options.outputs
        driven = {(self._message(outputs[name]).id, outputs[name].signal) for name in used}
        sent = {identifier for identifier, _ in driven}
        fills = []
        for name, output in outputs.items():
            message = self._message(output)
            place = message.id, output.signal
            if message.id not in sent or place in driven:
                continue
            if output.read_back is None:
                raise DeviceError(
                    f"{message.name} sets output {name} too, which no axis uses and nobody can "
                    f"read back: name its read_back, or use it together with {', '.join(used)}"
                )
            back, range_ = self._place(output.read_back), message.signals[output.signal].range
            fills.append(UnusedOutput(name, place, back, range_))
        return fills

    def _message(self, place: SignalPlace) -> DbcMessage:
        return self._messages[place.message]

    def _place(self, place: SignalPlace) -> tuple[int, SignalReader]:
        message = self._message(place)
        return message.id, SignalReader(message, place.signal)

    def _checksum(self, message: DbcMessage) -> Checksum | None:
        place = self._options.checksums.get(message.name)
        return None if place is None else Checksum(message, place.signal, place.algorithm)

    def _make_sent(self, name: str) -> Sent:
        message, options = self._messages[name], self._options
        constants = options.constants.get(name, {})
        return Sent(message, constants, options.counters.get(name), self._checksum(message))

    def _make_received(self, message: DbcMessage) -> Received:
        options, name = self._options, message.name
        counter, echo = options.counters.get(name), options.echoes.get(name)
        return Received(message, counter, echo, self._checksum(message))
