"""What is said to a PI controller, of either generation, that drives its axes in open loop."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from piezod.devices.bus.conversation import Conversation
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceError
from piezod_drivers.serial_line.gcs.identity import identity_of
from piezod_drivers.serial_line.gcs.reply import GcsReply
from piezod_drivers.serial_line.gcs.syntax import ASK_ERROR, Syntax, volts
from piezod_drivers.serial_line.quiet import until_quiet

MEASURED: Final = "VOL?"
"""The query of the voltage at the output, whoever drives it."""
_QUIET_NS: Final = 50_000_000
"""After so long without a byte nothing is left of what was before."""
_MOST_CHUNKS: Final = 20
_OPENING_NS: Final = 500_000_000
"""What is asked once may take longer than what is asked in the loop."""
_IDENTITY: Final = r"([^\n]{1,400})\n"


class GcsDrive(NamedTuple):
    """What is known of the outputs before anything is asked.

    Attributes:
        read_back: The query that tells what is in force.
        max_rate_hz: The fastest loop that the line can follow.
    """

    read_back: str
    max_rate_hz: float


class GcsDialogue(ABC):
    """Implements `ExchangingDialogue`; channels are the axes' identifiers.

    Outputs are set by `SVA`, with the servo off, and stay as they are when piezod goes. Positions
    and voltages are asked for in one write with what is set, and come back in one frame: a cycle
    takes one round trip.

    Args:
        line: The line.
        timeout_s: How long to wait for each reply in the loop, in s.
        syntax: Of the generation.
        wiring: The channels that are used.
        drive: What is known of the outputs.
    """

    def __init__(
        self, line: Line, timeout_s: float, syntax: Syntax, wiring: Wiring, drive: GcsDrive
    ) -> None:
        self._line, self._syntax, self._wiring, self._drive = line, syntax, wiring, drive
        self._conversation = Conversation(line, timeout_s)
        self._ranges: list[tuple[float, float]] = []
        self._told_ns: int | None = None
        self._told: Sequence[float] = ()
        self._flags = [NO_FLAGS] * (len(wiring.inputs) + len(wiring.outputs))
        self._outputs: Sequence[str] = wiring.outputs
        self._prepare()

    def open(self) -> Identity:
        """Connect, ask who is there, which axes it has and how far it drives; nothing is moved.

        Raises:
            DeviceUnavailableError: If the port is absent or held.
            DeviceError: If an axis is missing, or nobody knows the range of an output.
            LineFault: If an exchange fails.
        """
        self._line.open()
        self._calm()
        told = self._ask_once(b"*IDN?\n", GcsReply(_IDENTITY))
        identity = identity_of(told[0])
        axes = self._axes()
        self._outputs = self._voltage_ids(axes)
        self._prepare()
        self._ranges = self._find_ranges() if self._wiring.outputs else []
        return identity

    def close(self) -> None:
        """Let go of the line; outputs stay as they are. Never raises."""
        self._line.close()

    def capabilities(self) -> Capabilities:
        """Tell what the controller can do: it holds its outputs, and measures them."""
        inputs, outputs = self._wiring
        return Capabilities(inputs, outputs, True, self._drive.max_rate_hz, holds=True)

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Tell the lowest and the highest open-loop value of each output."""
        return self._ranges

    def activate(self) -> None:
        """Switch off what else drives the outputs, and keep them at the voltage they have.

        Raises:
            DeviceError: If the servo cannot be switched off, or what is in force is not known, or
                cannot be kept.
            LineFault: If an exchange fails.
        """
        foreign = self._driven_by_others()
        if not foreign:
            return
        if (asked := self._drive.read_back) != MEASURED:
            who = f"{self._line.where}: axis {', '.join(foreign)}"
            what = f"is driven by its servo or analog input, and {asked} does not tell its voltage"
            raise DeviceError(f"{who} {what}: switch that off at rest")
        held = {
            axis: self._holdable(axis, value, low, high)
            for axis, value, (low, high) in zip(
                self._wiring.outputs, self._ask_in_force(), self._ranges, strict=True
            )
            if axis in foreign
        }
        self._take_over(held)
        if still := self._driven_by_others():
            what = f"{self._line.where}: axis {', '.join(still)} does not give up its servo"
            raise DeviceError(what)

    def deactivate(self) -> None:  # noqa: B027 - it holds in every generation
        """Do nothing: the outputs hold."""

    def sample(self, now_ns: int) -> Reading:
        """Read every position and, in the same exchange, what is in force; call it in the loop."""
        return self._note(self._ask(self._sample_request, self._sample_reply), now_ns)

    def put(self, values: Sequence[float]) -> None:
        """Set every output and ask whether that was done; may be called in the loop."""
        request = self._setpoints(self._wiring.outputs, values)
        self._ask(request + ASK_ERROR, self._put_reply)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Read every position, set every output and read it back; may be called in the loop."""
        request = self._setpoints(self._wiring.outputs, values)
        whole = self._ask_positions + request + self._ask_voltages + ASK_ERROR
        return self._note(self._ask(whole, self._sample_reply), now_ns)

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Tell what was read in an exchange of this instant, or else ask; call it in the loop."""
        if now_ns != self._told_ns:
            self._told, self._told_ns = self._ask_in_force(), now_ns
        return self._told

    def flags(self) -> Sequence[Flags]:
        """Tell nothing that lasts: errors are told of the exchange that made them."""
        return self._flags

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong on the line without making an exchange fail; and forget it."""
        return self._conversation.take_noticed()

    @abstractmethod
    def _voltage_ids(self, axes: Sequence[str]) -> Sequence[str]:
        """Return what the outputs are called in a query of their voltage."""

    @abstractmethod
    def _find_ranges(self) -> list[tuple[float, float]]:
        """Return the lowest and the highest open-loop value of each output."""

    def _driven_by_others(self) -> Sequence[str]:
        """Return the outputs that `SVA` does not drive now."""
        return self._switched("SVO?", self._wiring.outputs, on=1)

    def _take_over(self, held: Mapping[str, float]) -> None:
        """Make `SVA` drive these axes, at the voltages that they have."""
        servos_off = self._syntax.setting("SVO", list(held), ["0"] * len(held))
        self._ask_once(servos_off + self._setpoints(list(held), list(held.values())), GcsReply())

    def _setpoints(self, axes: Sequence[str], values: Sequence[float]) -> bytes:
        """Return the request that sets these axes."""
        return self._syntax.setting("SVA", axes, volts(values))

    def _holdable(self, axis: str, value: float, low: float, high: float) -> float:
        """Return what is in force on an axis.

        Raises:
            DeviceError: If it is out of the range: to put it there would be a jump.
        """
        if low <= value <= high:
            return value
        what = f"{self._line.where}: axis {axis} is at {value:g}, beyond {low:g} to {high:g}"
        raise DeviceError(f"{what}, and would jump: move it there, or switch off its servo at rest")

    def _switched(self, query: str, ids: Sequence[str], *, on: int) -> list[str]:
        """Return the outputs whose switch is `on`; `ids` are theirs in the query."""
        if not ids:
            return []
        reply = GcsReply(*self._syntax.switches(ids), whole=self._syntax.bare)
        told = self._ask_once(self._syntax.query(query, ids), reply)
        return [a for a, state in zip(self._wiring.outputs, told, strict=True) if int(state) == on]

    def _ask(self, request: bytes, reply: GcsReply) -> list[float]:
        """Ask in the loop; what was told before may not be in force any more."""
        self._told_ns = None
        return reply.numbers(self._conversation.ask(request, reply.length_of))

    def _ask_once(self, request: bytes, reply: GcsReply) -> list[bytes]:
        request += ASK_ERROR
        frame = self._conversation.ask(request, reply.length_of, timeout_ns=_OPENING_NS)
        return reply.texts(frame)

    def _ask_in_force(self) -> Sequence[float]:
        return self._ask(self._ask_voltages + ASK_ERROR, self._voltages_reply)

    def _note(self, values: list[float], now_ns: int) -> Reading:
        n_inputs = len(self._wiring.inputs)
        self._told, self._told_ns = values[n_inputs:], now_ns
        return now_ns, values[:n_inputs]

    def _prepare(self) -> None:
        """Write the requests that are the same in every cycle."""
        inputs, outputs, syntax = self._wiring.inputs, self._outputs, self._syntax
        positions = syntax.numbers(inputs) if inputs else ()
        voltages = syntax.numbers(outputs) if outputs else ()
        self._ask_positions = syntax.query("POS?", inputs) if inputs else b""
        self._ask_voltages = syntax.query(self._drive.read_back, outputs) if outputs else b""
        self._sample_request = self._ask_positions + self._ask_voltages + ASK_ERROR
        self._sample_reply = GcsReply(*positions, *voltages)
        self._voltages_reply, self._put_reply = GcsReply(*voltages), GcsReply()

    def _calm(self) -> None:
        """Read away what was on its way, and the error of an earlier life or of being switched on.

        Half a request that was sent before makes an error with the `ERR?` behind it, no voltage.
        """
        self._conversation.restart()
        self._conversation.wait_out()
        until_quiet(self._line, _QUIET_NS, _MOST_CHUNKS)
        self._conversation.ask(ASK_ERROR, self._put_reply.length_of, timeout_ns=_OPENING_NS)

    def _axes(self) -> Sequence[str]:
        reply = GcsReply(self._syntax.axes(), whole=True)
        told = self._ask_once(b"SAI?\n", reply)
        axes = self._syntax.axes_in(told[0].decode())
        missing = [axis for axis in self._wiring.channels if axis not in axes]
        if missing:
            has, wanted = ", ".join(axes), ", ".join(missing)
            what = f"{self._line.where} has axes {has}, the configuration wants {wanted}"
            raise DeviceError(what)
        return axes
