"""What goes over the wire to a KPZ101 or TPZ001: voltages, in open loop."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceError
from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import FULL_SCALE, Id, StatusBit
from piezod_drivers.serial_line.thorlabs_apt.options import AptOptions
from piezod_drivers.serial_line.thorlabs_apt.session import CHANNEL, Cube

LIMIT_V: Final = {1: 75, 2: 100, 3: 150}
"""The voltage limits that an amplifier can be set to, by their codes."""
OPEN: Final = 1
OPEN_SMOOTH: Final = 3
SOFTWARE: Final = 0
ENABLED: Final = 1

_BYTES_PER_CYCLE: Final = 16 + 26
"""A voltage is asked for (6 + 10), then one is set and asked for (10 + 6 + 10)."""
_TOLERANCE: Final = FULL_SCALE // 1000
_REQUEST: Final = codec.short(Id.REQ_OUTPUT, CHANNEL)
_REQUEST_STATUS: Final = codec.short(Id.REQ_STATUS, CHANNEL)
_STATUS_NS: Final = 100_000_000
"""How often the status is asked for: its answer is put aside, and the next one found behind it."""
_LOCAL: Final = frozenset({DeviceFlag.LOCAL_MODE})


class AmplifierDialogue:
    """Implements `Dialogue`.

    A setting has no acknowledgement: the voltage is asked for in the same breath, and what the
    amplifier tells then must be what was set. After an exchange that failed, what is in force is
    asked for before anything else is set: an amplifier that was off meanwhile has forgotten it.

    Args:
        options: What a configuration says.
        wiring: The channels that are used: the output or none.
        line: The line to the amplifier.
    """

    def __init__(self, options: AptOptions, wiring: Wiring, line: Line) -> None:
        self._options, self._outputs = options, wiring.outputs
        self._cube = Cube(options, line)
        self._max_v = 0
        self._expected_bits = 0
        self._status_due_ns = 0
        self._least, self._doubtful = 0, False

    def open(self) -> Identity:
        """Connect, and ask who is there and what the voltage limit is.

        Raises:
            DeviceUnavailableError: If nobody is there.
            DeviceError: If it is another model, or set to another limit.
            LineFault: If an exchange fails.
        """
        identity = self._cube.open()
        (code,) = self._cube.ask_words(codec.short(Id.REQ_IO, CHANNEL), Id.GET_IO)
        max_v = LIMIT_V.get(code)
        if max_v is None:
            raise DeviceError(f"{self._cube.line.where} tells an unknown voltage limit: {code}")
        if self._options.max_v not in {None, max_v}:
            raise DeviceError(
                f"{self._cube.line.where} is limited to {max_v} V, the configuration says max_v: "
                f"{self._options.max_v}; set one of them to what the actuator stands"
            )
        self._max_v = max_v
        return identity

    def close(self) -> None:
        """Let go; the voltage stays. Never raises."""
        self._cube.close()

    def capabilities(self) -> Capabilities:
        """Tell what it can do."""
        rate_hz = self._options.baud / (10 * _BYTES_PER_CYCLE)
        return Capabilities((), self._outputs, True, rate_hz, holds=True)

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Tell the range of the voltage, in V."""
        return [(0.0, float(self._max_v))] * len(self._outputs)

    def activate(self) -> None:
        """Take control without a jump: of the input, of the output that is off.

        Raises:
            DeviceError: If it does not give control, or not without a jump: in closed loop nobody
                knows which voltage comes of opening it.
            LineFault: If an exchange fails.
        """
        if not self._outputs:
            return
        cube = self._cube
        mode = cube.ask_parameter(Id.REQ_CONTROL_MODE, Id.GET_CONTROL_MODE)
        if mode not in {OPEN, OPEN_SMOOTH}:
            what = "the amplifier is in closed loop, and its voltage would jump"
            raise DeviceError(f"{what}: open the loop at rest, at the device or with Kinesis")
        self._take_input(self._ask_status().output)
        self._enable()
        self._expected_bits = self._ask_status().bits & StatusBit.ENABLED
        self._least, self._doubtful, cube.line.status = 0, False, None

    def deactivate(self) -> None:
        """Hold the voltage."""

    def sample(self, now_ns: int) -> Reading:
        """Read nothing: it has no inputs."""
        return now_ns, ()

    def put(self, values: Sequence[float]) -> None:
        """Set the voltage, in V; may be called in the loop.

        Raises:
            LineFault: If the amplifier does not tell that it is set.
        """
        if self._doubtful:
            self._check(self._ask_output(b""))
        counts = round(values[0] / self._max_v * FULL_SCALE)
        self._least = min(self._least, counts)
        told = self._ask_output(codec.long(Id.SET_OUTPUT, codec.words(CHANNEL, counts)))
        if abs(told - counts) > _TOLERANCE:
            what = f"{counts} was set, {told} is told: somebody else sets it, or it does not obey"
            raise LineFault(DeviceFlag.LOCAL_MODE, what)
        self._least = counts

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        """Ask for the voltage, in V; may be called in the loop.

        Raises:
            LineFault: If no answer comes, or the amplifier has forgotten what was set.
        """
        told = self._ask_output(b"")
        self._check(told)
        return [told * self._max_v / FULL_SCALE]

    def flags(self) -> Sequence[Flags]:
        """Tell whether it was disabled, or put into closed loop; may be called in the loop."""
        status = self._cube.line.status
        if status is None:
            return [NO_FLAGS] * len(self._outputs)
        disabled = self._expected_bits & ~status.bits
        local = disabled or status.bits & StatusBit.CLOSED_LOOP
        return [_LOCAL if local else NO_FLAGS] * len(self._outputs)

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail; and forget it."""
        return self._cube.take_noticed()

    def _ask_output(self, before: bytes) -> int:
        """Send, and ask for the voltage in counts; now and then ask for the status beside it."""
        now_ns = self._cube.line.now_ns()
        if now_ns >= self._status_due_ns:
            self._status_due_ns = now_ns + _STATUS_NS
            before = _REQUEST_STATUS + before
        doubtful, self._doubtful = self._doubtful, True
        (told,) = self._cube.ask_words(before + _REQUEST, Id.GET_OUTPUT)
        self._doubtful = doubtful
        return told

    def _check(self, told: int) -> None:
        """Tell from a voltage of 0, where only others can be in force, that the amplifier was off.

        Raises:
            LineFault: `RESTARTED`, once.
        """
        forgotten = self._least > _TOLERANCE and told == 0
        self._doubtful = False
        if forgotten:
            self._least = 0
            raise LineFault(DeviceFlag.RESTARTED, "the voltage that was set is forgotten")

    def _ask_status(self) -> codec.CubeStatus:
        """Ask for what updates tell; none of these can be on its way, the last answer was later."""
        return codec.status_of(self._cube.ask(codec.short(Id.REQ_STATUS, CHANNEL), Id.GET_STATUS))

    def _take_input(self, output: int) -> None:
        """Let nothing but the host set the voltage."""
        (source,) = self._cube.ask_words(codec.short(Id.REQ_SOURCE, CHANNEL), Id.GET_SOURCE)
        if source == SOFTWARE:
            return
        added = output - self._ask_output(b"")
        if abs(added) > FULL_SCALE // 100:
            added_v = added * self._max_v / FULL_SCALE
            what = f"the knob or the input of the amplifier adds {added_v:.1f} V: turn it to zero"
            raise DeviceError(f"{what}, the voltage would jump")
        self._cube.tell(codec.long(Id.SET_SOURCE, codec.words(CHANNEL, SOFTWARE)))
        (source,) = self._cube.ask_words(codec.short(Id.REQ_SOURCE, CHANNEL), Id.GET_SOURCE)
        if source != SOFTWARE:
            raise DeviceError("the amplifier goes on obeying its knob or input: set it to software")

    def _enable(self) -> None:
        """Enable the output where it is not, from 0 V."""
        cube = self._cube
        if cube.ask_parameter(Id.REQ_ENABLED, Id.GET_ENABLED) == ENABLED:
            return
        self.put([0.0])
        cube.tell(codec.short(Id.SET_ENABLED, CHANNEL, ENABLED))
        if cube.ask_parameter(Id.REQ_ENABLED, Id.GET_ENABLED) != ENABLED:
            raise DeviceError("the amplifier does not enable its output: see what its display says")
