"""What is said to a device that speaks in lines of text, as its options have it."""

import re
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Final

from piezod.devices.bus.bus_device import LOSING
from piezod.devices.bus.conversation import Conversation, Fits
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceError
from piezod_drivers.serial_line.ascii_line.codec import (
    TAGS,
    AsciiLines,
    Exchange,
    Found,
    exchange,
    flagging,
    matched,
    number,
)
from piezod_drivers.serial_line.ascii_line.options import AsciiOptions
from piezod_drivers.serial_line.ascii_line.templates import TAG, parsed
from piezod_drivers.serial_line.quiet import until_quiet

UNKNOWN: Final = "unknown"
_ANY_TEXT: Final = re.compile(".*", re.DOTALL)
_NO_COMMAND: Final = parsed("~")
_QUIET_NS: Final = 100_000_000
_MOST_CHUNKS: Final = 20


class AsciiDialogue:
    """Implements `Dialogue` for a device that answers what it is asked.

    Args:
        line: The line, not open.
        options: What a configuration says, which fits together.
        wiring: Which channels are used.
    """

    def __init__(self, line: Line, options: AsciiOptions, wiring: Wiring) -> None:
        self._line, self._options, self._wiring = line, options, wiring
        self._talk = Conversation(line, options.timeout_ms * 1e-3)
        self._lines = AsciiLines(options)
        self._errors = flagging(options.errors)
        self._set = _using([exchange(ask) for ask in options.set], wiring.outputs)
        self._read = _using([exchange(ask) for ask in options.read], wiring.inputs)
        self._back = _using([exchange(ask) for ask in options.read_back], wiring.outputs)
        only_read = bool(options.outputs) and not wiring.outputs  # as `piezod probe` does
        self._start = [] if only_read else [exchange(ask) for ask in options.start]
        self._stop = [] if only_read else [exchange(ask) for ask in options.stop]
        self._tolerances = {name: output.tolerance for name, output in options.outputs.items()}
        status = options.status
        self._status_ns = 0
        self._status_every_ns = 0 if status is None else round(status.every_ms * 1e6)
        self._status_places = () if status is None else parsed(status.send)
        self._status_flags = () if status is None else flagging(status.flags)
        self._flags = NO_FLAGS
        self._broken = False
        self._tags = count()
        self._noticed: set[DeviceFlag] = set()

    def open(self) -> Identity:
        """Connect and ask who is there, where the options say how.

        Raises:
            DeviceError: If another device answers, or a command would set a channel of no axis.
        """
        for each in self._set:
            if unused := [name for name in each.names if name not in self._wiring.outputs]:
                what = f"a command sets channel {unused[0]} too, which serves no axis"
                raise DeviceError(
                    f"{what}: name it in an axis, or write its value into the command"
                )
        self._line.open()
        self._talk.restart()
        self._abort()
        self._flags = NO_FLAGS
        if self._options.identify is None:
            return Identity(UNKNOWN, f"device at {self._line.where}", UNKNOWN, UNKNOWN)
        who = exchange(self._options.identify)
        try:
            found = self._exchange(who, {}, anybody=True)
        except LineFault as fault:
            if fault.flag is DeviceFlag.GARBAGE:
                raise DeviceError(f"{self._line.where} is another device: {fault}") from fault
            raise
        told = [found.get(name, "").strip() or UNKNOWN for name in Identity._fields]
        return Identity(*told)

    def close(self) -> None:
        """Let go of the line; the outputs stay as they are."""
        self._line.close()

    def capabilities(self) -> Capabilities:
        """Tell what the options say."""
        return Capabilities(
            inputs=self._wiring.inputs,
            outputs=self._wiring.outputs,
            read_back=bool(self._back),
            max_rate_hz=self._options.max_rate_hz,
            holds=True,
        )

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Tell what the options say."""
        outputs = [self._options.outputs[name] for name in self._wiring.outputs]
        return [(output.lowest, output.highest) for output in outputs]

    def activate(self) -> None:
        """Send what comes at the start."""
        for each in self._start:
            self._exchange(each, {})

    def deactivate(self) -> None:
        """Send what comes at the end."""
        for each in self._stop:
            self._exchange(each, {})

    def sample(self, now_ns: int) -> Reading:
        """Read every input."""
        told = self._numbers(self._read, self._wiring.inputs)
        self._look_after()
        return now_ns, [told[name] for name in self._wiring.inputs]

    def put(self, values: Sequence[float]) -> None:
        """Set every output; where a device does not answer, ask what is in force.

        Raises:
            LineFault: If an exchange fails; `LOCAL_MODE` if it reads back another setpoint.
        """
        named = dict(zip(self._wiring.outputs, values, strict=True))
        answered = True
        for each in self._set:
            self._exchange(each, named)
            answered &= each.reply is not None
        if not answered:
            self._compare(named, self._numbers(self._back, self._wiring.outputs))
        self._look_after()

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - it is asked every time
        """Ask what is in force on each output."""
        told = self._numbers(self._back, self._wiring.outputs)
        return [told[name] for name in self._wiring.outputs]

    def flags(self) -> Sequence[Flags]:
        """Tell what the status said last; of every channel, as it names none."""
        return [self._flags] * (len(self._wiring.inputs) + len(self._wiring.outputs))

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail."""
        noticed, self._noticed = self._noticed | self._talk.take_noticed(), set()
        return noticed

    def _numbers(self, exchanges: Sequence[Exchange], channels: Sequence[str]) -> dict[str, float]:
        told = {}
        for each in exchanges:
            found = self._exchange(each, {})
            told.update({name: number(found[name]) for name in each.names if name in channels})
        return told

    def _compare(self, wanted: Mapping[str, float], told: Mapping[str, float]) -> None:
        for name, value in wanted.items():
            tolerance = self._tolerances[name]
            if tolerance is not None and abs(told[name] - value) > tolerance:
                what = f"{name} was set to {value:g}, {told[name]:g} is told: it does not obey"
                raise LineFault(DeviceFlag.LOCAL_MODE, what)

    def _exchange(
        self, each: Exchange, values: Mapping[str, float], *, anybody: bool = False
    ) -> Found:
        """Send a command and return what the groups of its answer match; call it in the loop.

        Args:
            each: The command and its answer.
            values: What stands in the command.
            anybody: Whether another answer is one too, as another device gives it.

        Raises:
            LineFault: If it is not answered as it should be.
        """
        tag = next(self._tags) % TAGS
        request = self._lines.request(each.places, {**values, TAG: tag})
        reply = each.reply
        if reply is None:
            self._tell(request)
            return {}

        def fits(line: bytes) -> bool:
            try:
                found = matched(self._lines.text(line), reply, self._errors)
            except LineFault as fault:
                return fault.flag is not DeviceFlag.GARBAGE
            return not each.tagged or (found[TAG].strip().isdecimal() and int(found[TAG]) == tag)

        is_reply = fits if each.tagged else None
        line = self._ask(request, is_reply, None if anybody else fits)
        return matched(self._lines.text(line), reply, self._errors)

    def _ask(self, request: bytes, is_reply: Fits | None = None, fits: Fits | None = None) -> bytes:
        try:
            return self._talk.ask(request, self._lines.length, is_reply, fits=fits)
        except LineFault as fault:
            self._broken |= fault.flag is DeviceFlag.PARTIAL_WRITE
            raise

    def _tell(self, request: bytes) -> None:
        try:
            self._talk.tell(request)
        except LineFault as fault:
            self._broken |= fault.flag is DeviceFlag.PARTIAL_WRITE
            raise

    def _abort(self) -> None:
        """Make half a command that went out one that nobody knows, and read away what it says."""
        if self._broken:
            self._line.send(self._lines.request(_NO_COMMAND, {}))
            self._broken = False
            until_quiet(self._line, _QUIET_NS, _MOST_CHUNKS)

    def _look_after(self) -> None:
        """Ask for a status that is due; never before a setpoint."""
        now_ns = self._line.now_ns()
        if not self._status_flags or now_ns - self._status_ns < self._status_every_ns:
            return
        self._status_ns = now_ns
        request = self._lines.request(self._status_places, {TAG: next(self._tags) % TAGS})
        try:
            text = self._lines.text(self._ask(request))
            matched(text, _ANY_TEXT, self._errors)
        except LineFault as fault:
            if fault.flag in LOSING:
                raise
            self._noticed.add(fault.flag)
            return
        self._flags = frozenset(
            flag for pattern, flag in self._status_flags if pattern.fullmatch(text)
        )


def _using(exchanges: Sequence[Exchange], channels: Sequence[str]) -> list[Exchange]:
    """Return the exchanges that serve one of these channels."""
    return [each for each in exchanges if set(each.names) & set(channels)]
