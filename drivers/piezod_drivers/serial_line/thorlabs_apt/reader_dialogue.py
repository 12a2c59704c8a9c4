"""The conversation with a KSG101 or TSG001: readings of a strain gauge."""

from collections.abc import Sequence
from math import nan
from typing import Final, NamedTuple

from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceError
from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import FULL_SCALE, Id
from piezod_drivers.serial_line.thorlabs_apt.options import AptOptions
from piezod_drivers.serial_line.thorlabs_apt.session import CHANNEL, AptSession

_BYTES_PER_CYCLE: Final = 6 + 12
_UM_PER_TRAVEL: Final = 0.1  # the travel is reported in steps of 100 nm
_SATURATED: Final = frozenset({DeviceFlag.SATURATED})


class _Form(NamedTuple):
    """Identifiers of a request for a reading and of its reply."""

    request: int
    answer: int


_FORMS: Final = (
    _Form(Id.READING_7DE, Id.READING_7DF),
    _Form(Id.READING_7DD, Id.READING_7DE),
)
"""Sources differ: the first form is that of thorlabs-apt-protocol, the second of others."""


class ReaderDialogue:
    """Implements `Dialogue`.

    Args:
        options: Options of the cube.
        wiring: The channels in use: the input or none.
        line: The line to the reader.
    """

    def __init__(self, options: AptOptions, wiring: Wiring, line: Line) -> None:
        self._options, self._inputs = options, wiring.inputs
        self._session = AptSession(options, line)
        self._um_per_count = 0.0
        self._form = _FORMS[0]
        self._saturated = False

    def open(self) -> Identity:
        """Connect, identify the cube, read its travel and find the form of its readings.

        Raises:
            DeviceUnavailableError: If the port is absent.
            DeviceError: If it is another model, or has no travel.
            LineFault: If an exchange fails.
        """
        identity = self._session.open()
        full_scale_um = self._options.full_scale_um or self._travel_um()
        self._um_per_count = full_scale_um / FULL_SCALE
        self._find_form()
        return identity

    def close(self) -> None:
        """Disconnect. Never raises."""
        self._session.close()

    def capabilities(self) -> Capabilities:
        """Return the channel and the highest rate that the bit rate allows."""
        rate_hz = self._options.baud / (10 * _BYTES_PER_CYCLE)
        return Capabilities(self._inputs, (), False, rate_hz, quality=True)

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Return nothing: there are no outputs."""
        return ()

    def activate(self) -> None:
        """Do nothing: the reader always replies."""

    def deactivate(self) -> None:
        """Do nothing."""

    def sample(self, now_ns: int) -> Reading:
        """Read the gauge, in µm; NaN at the end of its range. Real-time safe.

        Raises:
            LineFault: If no reply comes.
        """
        count = self._read()
        # The reading is limited to the ends of its range.
        self._saturated = abs(count) >= FULL_SCALE
        position_um = nan if self._saturated else count * self._um_per_count
        return now_ns, [position_um] * len(self._inputs)

    def put(self, values: Sequence[float]) -> None:
        """Do nothing: there are no outputs."""

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        """Return nothing: there are no outputs."""
        return ()

    def flags(self) -> Sequence[Flags]:
        """Return whether the last reading was at an end of the range. Real-time safe."""
        return [_SATURATED if self._saturated else NO_FLAGS] * len(self._inputs)

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the flags of faults that no call has raised."""
        return self._session.take_noticed()

    def _read(self) -> int:
        request = codec.short(self._form.request, CHANNEL)
        # The second number is the smoothed reading, which would add a delay.
        return self._session.ask_words(request, self._form.answer, n=2)[0]

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

    def _find_form(self) -> None:
        """Find the request for readings that the reader answers.

        Raises:
            LineFault: If it answers none.
        """
        first, other = _FORMS
        known = self._session.answers(codec.short(first.request, CHANNEL), first.answer)
        self._form = first if known else other
        self._read()
