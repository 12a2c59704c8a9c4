"""The conversation with a KPZ101 or TPZ001: voltages, in open loop."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceError
from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import FULL_SCALE, Id, StatusBit
from piezod_drivers.serial_line.thorlabs_apt.options import AptOptions
from piezod_drivers.serial_line.thorlabs_apt.session import CHANNEL, AptSession
from piezod_drivers.serial_line.thorlabs_apt.side_request import SideRequest

LIMIT_V: Final = {1: 75, 2: 100, 3: 150}
"""The voltage limits of an amplifier, by their codes."""
# Codes of the control mode, the voltage source and the output.
OPEN: Final = 1
OPEN_SMOOTH: Final = 3
SOFTWARE: Final = 0
ENABLED: Final = 1

_BYTES_PER_CYCLE: Final = 16 + 26
"""The voltage is read (6 + 10), then set and read (10 + 6 + 10)."""
# 0.1 % of the range.
_TOLERANCE: Final = FULL_SCALE // 1000
_REQUEST: Final = codec.short(Id.REQ_OUTPUT, CHANNEL)
_REQUEST_STATUS: Final = codec.short(Id.REQ_STATUS, CHANNEL)
_LOCAL: Final = frozenset({DeviceFlag.LOCAL_MODE})
_NO_STATUS: Final = frozenset({DeviceFlag.LATE_REPLY})


class AmplifierDialogue(BaseDialogue):
    """Implements `Dialogue`.

    A setting has no reply. The voltage is requested in the same write, and must be the one that was
    set. After an exchange that failed, the voltage is read before another one is set: an amplifier
    that was switched off meanwhile has lost it.

    Args:
        wiring: The channels in use: the output or none.
    """

    def __init__(self, options: AptOptions, wiring: Wiring, line: Line) -> None:
        self._session = AptSession(options, line)
        super().__init__(wiring, self._session.line, self._session.conversation)
        self._options, self._outputs = options, wiring.outputs
        self._status = SideRequest(self._session.line, _REQUEST_STATUS, Id.GET_STATUS)
        self._max_v = 0
        self._expected_bits = 0
        self._lowest_set, self._unverified = 0, False

    def open(self) -> Identity:
        """Connect, identify the cube and read its voltage limit.

        Raises:
            DeviceError: If it is another model, or has another limit.
        """
        identity = self._session.open()
        (code,) = self._session.ask_words(codec.short(Id.REQ_IO, CHANNEL), Id.GET_IO)
        max_v = LIMIT_V.get(code)
        if max_v is None:
            raise DeviceError(
                f"{self._session.line.where} reports an unknown voltage limit: {code}"
            )
        # A wrong limit would scale every voltage: counts are fractions of it.
        if self._options.max_v not in {None, max_v}:
            raise DeviceError(
                f"{self._session.line.where} is limited to {max_v} V, configured is max_v: "
                f"{self._options.max_v}; set both to the limit of the actuator"
            )
        self._max_v = max_v
        self._ranges = [(0.0, float(max_v))] * len(self._outputs)
        return identity

    def capabilities(self) -> Capabilities:
        """Return the channel and the highest rate that the bit rate allows."""
        rate_hz = self._options.baud / (10 * _BYTES_PER_CYCLE)
        return Capabilities((), self._outputs, True, rate_hz, holds=True)

    def activate(self) -> None:
        """Take control without a jump: of the voltage source, and of a disabled output.

        Raises:
            DeviceError: If the amplifier does not give control, or only with a jump. In closed loop
                the voltage after opening the loop is unknown.
        """
        if not self._outputs:
            return
        session = self._session
        mode = session.ask_parameter(Id.REQ_CONTROL_MODE, Id.GET_CONTROL_MODE)
        if mode not in {OPEN, OPEN_SMOOTH}:
            what = "the amplifier is in closed loop, and its voltage would jump"
            raise DeviceError(f"{what}: open the loop at rest, at the device or with Kinesis")
        # The status has the voltage with the part of knob and input; the setpoint is without it.
        self._take_source(self._ask_status().output)
        self._enable()
        self._expected_bits = self._ask_status().bits & StatusBit.ENABLED
        self._lowest_set, self._unverified = 0, False
        self._status.restart()

    def put(self, values: Sequence[float]) -> None:
        """Set the voltage, in V. Real-time safe.

        Raises:
            LineFault: If the amplifier does not confirm it.
        """
        if self._unverified:
            self._check_not_restarted(self._ask_output(b""))
        counts = round(values[0] / self._max_v * FULL_SCALE)
        # Until it is confirmed, either voltage may be in force.
        self._lowest_set = min(self._lowest_set, counts)
        counts_now = self._ask_output(codec.long(Id.SET_OUTPUT, codec.words(CHANNEL, counts)))
        if abs(counts_now - counts) > _TOLERANCE:
            what = f"set to {counts}, reads back {counts_now}: other source, or disabled"
            raise LineFault(DeviceFlag.LOCAL_MODE, what)
        self._lowest_set = counts

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        """Read the voltage, in V. Real-time safe.

        Raises:
            LineFault: If no reply comes, or the amplifier has lost its voltage.
        """
        counts_now = self._ask_output(b"")
        self._check_not_restarted(counts_now)
        return [counts_now * self._max_v / FULL_SCALE]

    def flags(self) -> Sequence[Flags]:
        """Return whether the output was disabled or put into closed loop. Real-time safe.

        Without a status for one second this is unknown, and reported as a missing reply.
        """
        overdue = _NO_STATUS if self._status.overdue else NO_FLAGS
        frame = self._status.latest()
        if frame is None:
            return [overdue] * len(self._outputs)
        status = codec.status_of(frame)
        # Some amplifiers do not report the bit; then it is not expected.
        disabled = self._expected_bits & ~status.bits
        local = disabled or status.bits & StatusBit.CLOSED_LOOP
        return [overdue | _LOCAL if local else overdue] * len(self._outputs)

    def _ask_output(self, before: bytes) -> int:
        """Send `before` and read the voltage in counts; request the status if it is due."""
        # Set before the exchange: if it fails, the voltage in force is unknown.
        unverified, self._unverified = self._unverified, True
        (counts_now,) = self._session.ask_words(
            self._status.due() + before + _REQUEST, Id.GET_OUTPUT
        )
        self._unverified = unverified
        return counts_now

    def _check_not_restarted(self, counts_now: int) -> None:
        """Detect a restart: the voltage is 0, although only others were set.

        Raises:
            LineFault: `RESTARTED`, once.
        """
        lost = self._lowest_set > _TOLERANCE and counts_now == 0
        self._unverified = False
        if lost:
            self._lowest_set = 0
            raise LineFault(DeviceFlag.RESTARTED, "the amplifier has lost its voltage")

    def _ask_status(self) -> codec.CubeStatus:
        """Read the status; no unrequested one is pending, as the last reply came later."""
        return codec.status_of(self._session.ask(_REQUEST_STATUS, Id.GET_STATUS))

    def _take_source(self, output: int) -> None:
        """Make the host the only source of the voltage."""
        (source,) = self._session.ask_words(codec.short(Id.REQ_SOURCE, CHANNEL), Id.GET_SOURCE)
        if source == SOFTWARE:
            return
        added = output - self._ask_output(b"")
        # Up to 1 % of the range may lie between the measured and the set voltage.
        if abs(added) > FULL_SCALE // 100:
            added_v = added * self._max_v / FULL_SCALE
            what = f"the knob or the input of the amplifier adds {added_v:.1f} V"
            raise DeviceError(f"{what}, and the voltage would jump: turn it to zero")
        self._session.tell(codec.long(Id.SET_SOURCE, codec.words(CHANNEL, SOFTWARE)))
        (source,) = self._session.ask_words(codec.short(Id.REQ_SOURCE, CHANNEL), Id.GET_SOURCE)
        if source != SOFTWARE:
            raise DeviceError(
                "the amplifier still obeys its knob or input: set its source to software"
            )

    def _enable(self) -> None:
        """Enable a disabled output, starting from 0 V."""
        session = self._session
        if session.ask_parameter(Id.REQ_ENABLED, Id.GET_ENABLED) == ENABLED:
            return
        # A disabled output is at 0 V: with a setpoint of 0 V, enabling it is no jump.
        self.put([0.0])
        session.tell(codec.short(Id.SET_ENABLED, CHANNEL, ENABLED))
        if session.ask_parameter(Id.REQ_ENABLED, Id.GET_ENABLED) != ENABLED:
            raise DeviceError("the amplifier does not enable its output: read its display")
