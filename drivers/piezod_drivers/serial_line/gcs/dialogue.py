"""The conversation with a PI controller of either generation that drives in open loop."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.conversation import Conversation
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.errors import DeviceError
from piezod.units import s_to_ns
from piezod_drivers.serial_line.gcs.identity import identity_of
from piezod_drivers.serial_line.gcs.reply import GcsReply
from piezod_drivers.serial_line.gcs.syntax import ASK_ERROR, Syntax, volts
from piezod_drivers.serial_line.quiet import read_until_quiet

MEASURED: Final = "VOL?"
"""Query of the voltage at the output, independent of what drives it."""
_QUIET_NS: Final = 50_000_000
"""After a silence of this length nothing of earlier exchanges is pending."""
# Ends the wait on a line that is never quiet.
_MOST_CHUNKS: Final = 20
OPENING_NS: Final = 500_000_000
"""Time-out of requests outside the loop, which may take longer."""
_IDENTITY: Final = r"([^\n]{1,400})\n"


class GcsDrive(NamedTuple):
    """Properties of the outputs that are known before the device is opened."""

    read_back: str  #: Query of the value in force.
    max_rate_hz: float  #: Highest rate that the line allows.


class GcsDialogue(BaseDialogue, ABC):
    """Implements `ExchangingDialogue`; channels are the identifiers of the axes.

    `SVA` sets the outputs, with the servo off, and they hold their values when piezod disconnects.
    One write contains the setpoints and the queries of positions and voltages, and their replies
    form one frame: a cycle takes one round trip.

    Args:
        timeout_s: Longest wait for each reply in the loop, in s.
        syntax: Text format of the generation.
        drive: Properties of the outputs.

    Attributes:
        conversation: Requests and replies.
        slow_ns: Longest wait for a reply outside of the loop, in ns.
        syntax: Text format of the generation.
        wiring: The channels in use.
    """

    def __init__(
        self, line: Line, timeout_s: float, syntax: Syntax, wiring: Wiring, drive: GcsDrive
    ) -> None:
        self.conversation = Conversation(line, timeout_s)
        super().__init__(wiring, line, self.conversation)
        self._line, self.syntax, self.wiring, self._drive = line, syntax, wiring, drive
        self.slow_ns = max(OPENING_NS, s_to_ns(timeout_s))
        self._outputs: Sequence[str] = wiring.outputs
        self._prepare_requests()

    def open(self) -> Identity:
        """Connect, identify the controller, read its axes and ranges; nothing moves.

        Raises:
            DeviceError: If an axis is missing, or the range of an output is unknown.
        """
        self._line.open()
        self._drain()
        replies = self.ask_slowly(b"*IDN?\n", GcsReply(_IDENTITY))
        identity = identity_of(replies[0])
        axes = self._axes()
        # The identifiers of the outputs may depend on the order of the axes, so the requests are
        # prepared again.
        self._outputs = self._output_ids(axes)
        self._prepare_requests()
        self._ranges = self._find_ranges() if self.wiring.outputs else []
        return identity

    def capabilities(self) -> Capabilities:
        """Return the capabilities: outputs hold and are read back."""
        inputs, outputs = self.wiring
        return Capabilities(inputs, outputs, True, self._drive.max_rate_hz, holds=True)

    def activate(self) -> None:
        """Take over the outputs from servo or analog input, at their present voltages.

        Raises:
            DeviceError: If a servo cannot be switched off, or a present voltage is unknown or
                cannot be kept.
        """
        foreign = self._driven_by_others()
        if not foreign:
            return
        # `SVA?` returns the last setpoint of `SVA`, which may differ from the voltage that the
        # servo applies.
        if (asked := self._drive.read_back) != MEASURED:
            which = f"{self._line.where}: axis {', '.join(foreign)}"
            what = (
                f"is driven by its servo or analog input, and {asked} does not measure its voltage"
            )
            raise DeviceError(f"{which} {what}: switch them off at rest")
        held = {
            axis: self._require_in_range(axis, value, low, high)
            for axis, value, (low, high) in zip(
                self.wiring.outputs, self._ask_in_force(), self._ranges, strict=True
            )
            if axis in foreign
        }
        self._take_over(held)
        # Read back, because a set command has no reply of its own.
        if still := self._driven_by_others():
            what = f"{self._line.where}: the servo of axis {', '.join(still)} stays on"
            raise DeviceError(what)

    def sample(self, now_ns: int) -> Reading:
        """Read every position and every voltage in one exchange. Real-time safe."""
        return self._keep_read_back(self._ask(self._sample_request, self._sample_reply), now_ns)

    def put(self, values: Sequence[float]) -> None:
        """Set every output and check that the controller accepted it. Real-time safe."""
        request = self._setpoints(self.wiring.outputs, values)
        self._ask(request + ASK_ERROR, self._put_reply)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Read every position, set every output and read it back. Real-time safe."""
        request = self._setpoints(self.wiring.outputs, values)
        # Positions are read before the setpoint: the sample belongs to the voltage before it.
        whole = self._ask_positions + request + self._ask_voltages + ASK_ERROR
        return self._keep_read_back(self._ask(whole, self._sample_reply), now_ns)

    def ask_slowly(self, request: bytes, reply: GcsReply) -> list[bytes]:
        """Send a request and return the values of its reply. Not real-time safe.

        Raises:
            LineFault: If the controller refuses or does not reply.
        """
        # A set command has no reply; `ERR?` behind it confirms it and ends the frame.
        request += ASK_ERROR
        frame = self.conversation.ask(request, reply.length_of, timeout_ns=self.slow_ns)
        return reply.texts(frame)

    @abstractmethod
    def _output_ids(self, axes: Sequence[str]) -> Sequence[str]:
        """Return the identifiers of the outputs in a query of their voltage."""

    @abstractmethod
    def _find_ranges(self) -> list[tuple[float, float]]:
        """Return the range of the open-loop value of each output."""

    def _driven_by_others(self) -> Sequence[str]:
        """Return the outputs that `SVA` does not drive now."""
        return self._outputs_switched("SVO?", self.wiring.outputs, on=1)

    def _take_over(self, held: Mapping[str, float]) -> None:
        """Make `SVA` drive these axes, at their present voltages."""
        # One write: the setpoint follows the servo at once, so the output does not leave its
        # voltage.
        servos_off = self.syntax.setting("SVO", list(held), ["0"] * len(held))
        self.ask_slowly(servos_off + self._setpoints(list(held), list(held.values())), GcsReply())

    def _setpoints(self, axes: Sequence[str], values: Sequence[float]) -> bytes:
        """Return the command that sets these axes."""
        return self.syntax.setting("SVA", axes, volts(values))

    def _require_in_range(self, axis: str, value: float, low: float, high: float) -> float:
        """Return the value in force on an axis.

        Raises:
            DeviceError: If it is out of range: setting the nearest allowed value would be a jump.
        """
        if low <= value <= high:
            return value
        what = f"{self._line.where}: axis {axis} is at {value:g}, allowed range {low:g} to {high:g}"
        raise DeviceError(
            f"{what}, and would jump: move it into range, or switch off its servo at rest"
        )

    def _outputs_switched(self, query: str, ids: Sequence[str], *, on: int) -> list[str]:
        """Return the outputs whose switch has the value `on`; `ids` name them in the query."""
        if not ids:
            return []
        # A bare "0" or "1" of GCS 1 looks like the reply to `ERR?`.
        reply = GcsReply(*self.syntax.switches(ids), whole=self.syntax.bare)
        replies = self.ask_slowly(self.syntax.query(query, ids), reply)
        return [
            a for a, state in zip(self.wiring.outputs, replies, strict=True) if int(state) == on
        ]

    def _ask(self, request: bytes, reply: GcsReply) -> list[float]:
        """Send a request in the loop; the values in force are unknown until it succeeds."""
        self._forget_in_force()
        return reply.numbers(self.conversation.ask(request, reply.length_of))

    def _ask_in_force(self) -> Sequence[float]:
        return self._ask(self._ask_voltages + ASK_ERROR, self._voltages_reply)

    def _keep_read_back(self, values: list[float], now_ns: int) -> Reading:
        n_inputs = len(self.wiring.inputs)
        self._keep_in_force(values[n_inputs:], now_ns)
        return now_ns, values[:n_inputs]

    def _prepare_requests(self) -> None:
        """Prepare the requests that are the same in every cycle."""
        inputs, outputs, syntax = self.wiring.inputs, self._outputs, self.syntax
        positions = syntax.numbers(inputs) if inputs else ()
        voltages = syntax.numbers(outputs) if outputs else ()
        self._ask_positions = syntax.query("POS?", inputs) if inputs else b""
        self._ask_voltages = syntax.query(self._drive.read_back, outputs) if outputs else b""
        self._sample_request = self._ask_positions + self._ask_voltages + ASK_ERROR
        self._sample_reply = GcsReply(*positions, *voltages)
        self._voltages_reply, self._put_reply = GcsReply(*voltages), GcsReply()

    def _drain(self) -> None:
        """Discard pending replies, and the error of an earlier connection or of power-up.

        Half a command that was sent before becomes an error together with this `ERR?`, not a
        voltage.
        """
        self.conversation.restart()
        self.conversation.wait_out()
        read_until_quiet(self._line, _QUIET_NS, _MOST_CHUNKS)
        with self.conversation.opening():
            self.conversation.ask(ASK_ERROR, self._put_reply.length_of, timeout_ns=self.slow_ns)

    def _axes(self) -> Sequence[str]:
        reply = GcsReply(self.syntax.axes(), whole=True)
        replies = self.ask_slowly(b"SAI?\n", reply)
        axes = self.syntax.axes_in(replies[0].decode())
        missing = [axis for axis in self.wiring.channels if axis not in axes]
        if missing:
            has, wanted = ", ".join(axes), ", ".join(missing)
            what = f"{self._line.where} has axes {has}, but not the configured {wanted}"
            raise DeviceError(what)
        return axes
