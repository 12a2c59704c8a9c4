"""The conversation with a KSG101 or TSG001: readings of a strain gauge."""

from collections.abc import Sequence
from math import nan
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, SATURATED, DeviceFlag, Flags
from piezod.errors import DeviceError
from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import FULL_SCALE, DisplayMode, Id
from piezod_drivers.serial_line.thorlabs_apt.options import AptOptions
from piezod_drivers.serial_line.thorlabs_apt.session import CHANNEL, AptSession
from piezod_drivers.serial_line.thorlabs_apt.side_request import SideRequest

_BYTES_PER_CYCLE: Final = 6 + 12
_UM_PER_TRAVEL: Final = 0.1  # the travel is reported in steps of 100 nm
_REQUEST: Final = codec.short(Id.REQ_READING, CHANNEL)
_REQUEST_IO: Final = codec.short(Id.REQ_GAUGE_IO, CHANNEL)
_NO_MODE: Final = frozenset({DeviceFlag.LATE_REPLY})
_QUANTITIES: Final[dict[int, str]] = {
    DisplayMode.VOLTAGE: "a voltage",
    DisplayMode.FORCE: "a force",
}


class ReaderDialogue(BaseDialogue):
    """Implements `Dialogue`.

    The readings are in the quantity that the reader shows, so they are positions only in one of its
    display modes. A knob of the reader changes the mode, so it is requested all the time.

    Args:
        wiring: The channels in use: the input or none.
    """

    def __init__(self, options: AptOptions, wiring: Wiring, line: Line) -> None:
        self._session = AptSession(options, line)
        super().__init__(wiring, self._session.line, self._session.conversation)
        self._options, self._inputs = options, wiring.inputs
        self._mode = SideRequest(self._session.line, _REQUEST_IO, Id.GET_GAUGE_IO)
        self._um_per_count = 0.0
        self._saturated = False

    def open(self) -> Identity:
        """Connect, identify the cube, and read its display mode and its travel.

        Raises:
            DeviceError: If it is another model, has no travel, or shows no position.
        """
        identity = self._session.open()
        mode = codec.display_mode_of(self._session.ask(_REQUEST_IO, Id.GET_GAUGE_IO))
        if mode != DisplayMode.POSITION:
            raise DeviceError(f"{self._session.line.where}: {_no_position(mode)}")
        full_scale_um = self._options.full_scale_um or self._travel_um()
        self._um_per_count = full_scale_um / FULL_SCALE
        self._mode.restart()
        return identity

    def capabilities(self) -> Capabilities:
        """Return the channel and the highest rate that the bit rate allows."""
        rate_hz = self._options.baud / (10 * _BYTES_PER_CYCLE)
        return Capabilities(self._inputs, (), False, rate_hz, quality=True)

    def sample(self, now_ns: int) -> Reading:
        """Read the gauge, in µm; NaN at the end of its range. Real-time safe.

        Raises:
            LineFault: If no reply comes, or the reader shows another quantity.
        """
        # The second number is the smoothed reading, which would add a delay.
        request = self._mode.due() + _REQUEST
        count = self._session.ask_words(request, Id.GET_READING, n=2)[0]
        self._check_mode()
        # The reading is limited to the ends of its range.
        self._saturated = abs(count) >= FULL_SCALE
        position_um = nan if self._saturated else count * self._um_per_count
        return now_ns, [position_um] * len(self._inputs)

    def flags(self) -> Sequence[Flags]:
        """Return whether the last reading was at an end of the range. Real-time safe.

        Without its display mode for one second the quantity of the readings is unknown, and this is
        reported as a missing reply.
        """
        if self._mode.overdue:
            return [_NO_MODE] * len(self._inputs)
        return [SATURATED if self._saturated else NO_FLAGS] * len(self._inputs)

    def _check_mode(self) -> None:
        """Refuse readings of another quantity.

        Raises:
            LineFault: `WRONG_REQUEST` while the reader shows another quantity; `LATE_REPLY` if it
                has not reported its mode for too long.
        """
        if self._mode.overdue:
            raise LineFault(DeviceFlag.LATE_REPLY, "the reader does not report its display mode")
        frame = self._mode.latest()
        if frame is None:
            return
        mode = codec.display_mode_of(frame)
        if mode != DisplayMode.POSITION:
            raise LineFault(DeviceFlag.WRONG_REQUEST, _no_position(mode))

    def _travel_um(self) -> float:
        request = codec.short(Id.REQ_MAX_TRAVEL, CHANNEL)
        (travel,) = self._session.ask_words(request, Id.GET_MAX_TRAVEL)
        if travel == 0:
            where = self._session.line.where
            raise DeviceError(
                f"{where} does not report the travel of an actuator: set full_scale_um"
            )
        # `ask_words` returns signed numbers, but the travel is unsigned.
        return (travel & 0xFFFF) * _UM_PER_TRAVEL


def _no_position(mode: int) -> str:
    """Return what the reader shows instead of a position, and the remedy."""
    shown = _QUANTITIES.get(mode, f"an unknown quantity ({mode})")
    return f"the reader shows {shown}: set its display to position, at the cube or with Kinesis"
