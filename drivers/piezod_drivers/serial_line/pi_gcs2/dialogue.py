"""The conversation with a PI controller that speaks GCS 2.0."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Final

from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Identity, Wiring
from piezod.devices.player import AtEnd
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.gcs.dialogue import MEASURED, GcsDialogue, GcsDrive
from piezod_drivers.serial_line.gcs.rate import NETWORK_RATE_HZ, wire_rate_hz
from piezod_drivers.serial_line.gcs.reply import GcsReply
from piezod_drivers.serial_line.pi_gcs2.codec import Gcs2Syntax
from piezod_drivers.serial_line.pi_gcs2.options import Gcs2Options
from piezod_drivers.serial_line.pi_gcs2.player import Gcs2Player

_BITS: Final = 10
"""Bits of a byte on a serial line."""
_REFUSALS: Final = frozenset({DeviceFlag.WRONG_REQUEST, DeviceFlag.LOCAL_MODE})


class Gcs2Dialogue(GcsDialogue):
    """The conversation with a GCS 2.0 controller.

    Attributes:
        numbers: Number of the piezo channel and of the wave generator of each output.
        player: Plays tables on the outputs.
    """

    def __init__(self, line: Line, options: Gcs2Options, wiring: Wiring) -> None:
        serial_hz = wire_rate_hz(options.baud, len(wiring.channels))
        rate_hz = serial_hz if options.host is None else NETWORK_RATE_HZ
        drive = GcsDrive(options.read_back, rate_hz)
        super().__init__(line, options.timeout_ms * 1e-3, Gcs2Syntax(), wiring, drive)
        self._range_v = options.range_v
        self._by_channel = options.read_back == MEASURED
        self.numbers: Sequence[str] = ()
        byte_ns = 0 if options.host is not None else _BITS * NS_PER_S // options.baud
        at_end = AtEnd(options.wave_end)
        self.player = Gcs2Player(
            self,
            at_end,
            measures=self._by_channel,
            byte_ns=byte_ns,
            pulse_lines=options.trigger_outputs,
        )

    def open(self) -> Identity:
        """Connect, identify the controller, read its axes and ranges; nothing moves.

        Raises:
            DeviceError: If an axis is missing, or the range of an output is unknown.
        """
        self.player.forget()
        return super().open()

    def activate(self) -> None:
        """Stop wave generators that are found; then take over the outputs.

        Raises:
            DeviceError: If an output cannot be taken over.
        """
        if self.player.stop_found() and not self._by_channel:
            what = f"{self._line.where}: a wave generator was running, and was stopped"
            raise DeviceError(f"{what}; SVA? does not measure its voltage: use read_back: VOL?")
        super().activate()

    def _output_ids(self, axes: Sequence[str]) -> Sequence[str]:
        """Return the numbers of the piezo channels: an axis' own number, or its index from 1."""
        outputs = self.wiring.outputs
        # `VOL?`, `VMI?`, `VMA?` and `ONL` address piezo channels, not axes.
        self.numbers = [a if a.isdigit() else str(axes.index(a) + 1) for a in outputs]
        return self.numbers if self._by_channel else outputs

    def _find_ranges(self) -> list[tuple[float, float]]:
        if self._range_v is not None:
            return [self._range_v] * len(self.numbers)
        try:
            lowest, highest = self._limits("VMI?"), self._limits("VMA?")
        except LineFault as fault:
            if fault.flag is not DeviceFlag.WRONG_REQUEST:
                raise
            what = f"{self._line.where} does not report the range of its outputs: give range_v"
            raise DeviceError(what) from fault
        return list(zip(lowest, highest, strict=True))

    def _limits(self, query: str) -> list[float]:
        reply = GcsReply(*self.syntax.numbers(self.numbers))
        request = self.syntax.query(query, self.numbers)
        limits = [float(text) for text in self.ask_slowly(request, reply)]
        if not all(map(isfinite, limits)):
            what = f"{self._line.where} reports an infinite range: {limits}; give range_v"
            raise DeviceError(what)
        return limits

    def _driven_by_others(self) -> Sequence[str]:
        others = {*super()._driven_by_others(), *self._offline()}
        return [axis for axis in self.wiring.outputs if axis in others]

    def _offline(self) -> Sequence[str]:
        """Return the outputs that an analog input drives; none if there is no such mode."""
        try:
            return self._outputs_switched("ONL?", self.numbers, on=0)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.WRONG_REQUEST:
                raise
            # Controllers without analog inputs do not know `ONL`.
            return ()

    def _take_over(self, held: Mapping[str, float]) -> None:
        # Offline channels first: if one refuses, no servo was switched off and nothing has moved.
        offline = [axis for axis in self._offline() if axis in held]
        if offline:
            self._bring_online({axis: held[axis] for axis in offline})
        if others := {axis: value for axis, value in held.items() if axis not in offline}:
            super()._take_over(others)

    def _bring_online(self, held: Mapping[str, float]) -> None:
        """Make `SVA` drive channels instead of their analog inputs, at the same voltages.

        A value that is set while a channel is offline takes effect with `ONL`; no older setpoint
        ever does. A servo that is on as well is not switched off, because then the analog input
        would drive the output. The controller then refuses the setpoint.

        Raises:
            DeviceError: If it refuses; nothing has moved.
        """
        axes = list(held)
        try:
            self.ask_slowly(self._setpoints(axes, list(held.values())), GcsReply())
        except LineFault as fault:
            if fault.flag not in _REFUSALS:
                raise
            what = f"{self._line.where}: axis {', '.join(axes)} is driven by its analog input"
            remedy = "switch off its analog input and its servo at rest"
            raise DeviceError(f"{what} and refuses a setpoint ({fault}): {remedy}") from fault
        channels_of = dict(zip(self.wiring.outputs, self.numbers, strict=True))
        online = [channels_of[axis] for axis in axes]
        self.ask_slowly(self.syntax.setting("ONL", online, ["1"] * len(online)), GcsReply())
