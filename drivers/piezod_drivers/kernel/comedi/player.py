"""Plays a table on a converter card: one command drives the outputs, another one samples.

Both commands have the same interval, and the card's clocks. That of the inputs starts first, that
of the outputs one system call later: samples and points are in step but for some µs. The host fills
the buffer of the outputs each cycle. If it dies, the kernel cancels the play.
"""

from math import lcm, nan
from typing import TYPE_CHECKING, Final

from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.player import (
    AtEnd,
    Check,
    PlayedRecord,
    PlayerCapabilities,
    PlayState,
    Progress,
    Table,
)
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod.units import NS_PER_S
from piezod_drivers.kernel.comedi import library as names
from piezod_drivers.kernel.comedi.card import Pin, Timing
from piezod_drivers.kernel.comedi.play_stream import MOST_SCANS, InStream, OutStream

if TYPE_CHECKING:
    from collections.abc import Sequence

    from piezod_drivers.kernel.comedi.dialogue import ComediDialogue
    from piezod_drivers.kernel.comedi.wired_card import WiredCard, WiredPin

POINTS: Final = 2_000_000
CYCLES: Final = 1_000_000
LEAST_BUFFER_NS: Final = NS_PER_S // 2
"""The buffers last at least this long: a late cycle must not end a play."""
LONGEST_INTERVAL_NS: Final = NS_PER_S
_LARGEST_STEP_NS: Final = 1 << 20
"""Where the step of the intervals is looked for, in ns."""


class ComediPlayer:
    """Implements `PlayDialogue` for a card whose outputs are measured by inputs.

    With inputs in use, they and the measuring inputs are sampled by a command; without, the
    measuring inputs are read one by one.

    Args:
        dialogue: The dialogue with the card.
    """

    def __init__(self, dialogue: "ComediDialogue") -> None:
        self._dialogue = dialogue
        self._table: Table | None = None
        self._out, self._in = OutStream(b"", b"", 0), InStream(1, 0)
        self._parts = b"", b""
        self._out_width = self._in_width = 2  # bytes of a code: asked once for a play

    def capabilities(self) -> PlayerCapabilities:
        """Ask the card for its shortest interval, the step of intervals, and its buffers.

        Raises:
            DeviceError: If it has no commands.
            LineFault: If the kernel refuses.
        """
        from piezod_drivers.kernel.comedi import play_arrays  # noqa: F401, PLC0415 - numpy, in time

        wired, shortest_ns, step_ns = self._wired, 1, 1
        for pins in self._commands():
            self._require_commands(pins[0].subdevice)
            scan_bytes = len(pins) * self._width(pins)
            n_scans = wired.card.buffer_bytes(pins[0].subdevice) // scan_bytes
            least_ns = wired.card.test(pins, Timing(1, 2)).interval_ns
            shortest_ns = max(shortest_ns, least_ns, -(-LEAST_BUFFER_NS // n_scans))
            step_ns = lcm(step_ns, self._step_ns(pins, least_ns))
        converters = [converter for _, converter in wired.outputs]
        return PlayerCapabilities(
            shortest_interval_ns=-(-shortest_ns // step_ns) * step_ns,
            interval_step_ns=step_ns,
            longest_interval_ns=LONGEST_INTERVAL_NS // step_ns * step_ns,
            points=POINTS,
            points_shared=False,
            resolution=tuple(abs(one.value(1) - one.value(0)) for one in converters),
            cycles=CYCLES,
            replaces=False,
            record_points=MOST_SCANS if wired.inputs else 0,
            records_with_play=True,
            at_end=AtEnd.HOLDS,
        )

    def load(self, table: Table, check: Check) -> Table:
        """Turn a table into codes; return it with the voltages of these codes.

        Raises:
            DeviceError: If the card cannot play at this interval, or so many points.
            LineFault: If the kernel refuses.
        """
        from piezod_drivers.kernel.comedi import play_arrays  # noqa: PLC0415 - numpy

        check()
        wanted = Timing(table.interval_ns, table.n_points)
        for pins in self._commands():
            found = self._wired.card.test(pins, wanted)
            if found != wanted:
                raise DeviceError(
                    f"the card would play {found.n_scans} points every {found.interval_ns} ns, "
                    f"asked: {wanted.n_scans} every {wanted.interval_ns} ns; change the interval"
                )
        outputs = self._wired.outputs
        converters, width = [one for _, one in outputs], self._width([pin for pin, _ in outputs])
        lead_in, period = (
            play_arrays.bytes_of(part, converters, width) for part in (table.lead_in, table.period)
        )
        self._parts, self._table = (lead_in, period), play_arrays.quantised(table, converters)
        return self._table

    def arm(self) -> None:
        """Do nothing: a prepared command would keep set-points from the outputs."""

    def start(self) -> None:
        """Fill the buffer of the outputs, and start both commands.

        Raises:
            LineFault: If the kernel refuses.
        """
        table, card = self._require_table(), self._wired.card
        timing = Timing(table.interval_ns, table.n_points)
        driven, *sampled = self._commands()
        self._out = OutStream(*self._parts, table.cycles)
        self._out_width = self._width(driven)
        card.command(driven, timing)
        self._fill()
        for pins in sampled:
            self._in_width = self._width(pins)
            self._in = InStream(len(pins) * self._in_width, timing.n_scans)
            card.command(pins, timing)
            card.trigger(pins[0].subdevice)
        card.trigger(driven[0].subdevice)

    def progress(self, now_ns: int) -> Progress:  # noqa: ARG002 - the interface's
        """Fill the buffer of the outputs, and empty that of the inputs. Real-time safe."""
        table, card = self._require_table(), self._wired.card
        subdevice = self._wired.outputs[0].pin.subdevice
        runs = bool(card.flags(subdevice) & names.RUNNING)
        try:
            if self._wired.inputs and not self._in.complete:
                while data := card.take():
                    self._in.add(data)
            self._fill()
        except LineFault as fault:
            if fault.flag is DeviceFlag.DISCONNECTED:
                raise
            return self._failed(table, f"the card has lost points or samples: {fault}")
        if runs:
            return Progress(PlayState.PLAYING, self._cycle(table))
        if not self._out.complete or card.waiting_bytes(subdevice):
            return self._failed(table, "the card has stopped: its buffer was empty, or it failed")
        if self._wired.inputs and not self._in.complete:
            return Progress(PlayState.PLAYING, self._cycle(table))
        self._cancel()
        # It changes nothing, and refreshes what the kernel keeps as the last value.
        self._wired.put(table.period[-1].tolist())
        return Progress(PlayState.ENDED, table.cycles)

    def stop(self) -> "Sequence[float]":
        """Cancel both commands; return the measured outputs. Real-time safe."""
        self._cancel()
        return self._wired.measured()

    def recording(self, check: Check) -> PlayedRecord:
        """Return the samples, and the outputs that were measured beside them."""
        from piezod_drivers.kernel.comedi import play_arrays  # noqa: PLC0415 - numpy

        check()
        table, wired = self._require_table(), self._wired
        sampled = [*wired.inputs, *wired.measuring]
        converters, pins = [one for _, one in sampled], [pin for pin, _ in sampled]
        data = self._in.kept() if wired.inputs else b""
        values = play_arrays.samples_of(data, converters, self._width(pins))
        n_inputs = len(wired.inputs)
        return PlayedRecord(table.interval_ns, values[:, :n_inputs], 0, values[:, n_inputs:])

    def sample(self, now_ns: int) -> Reading:
        """Return the newest scan, NaN before the first one. Real-time safe."""
        return now_ns, self._newest(self._wired.inputs, 0)

    def in_force(self, now_ns: int) -> "Sequence[float]":  # noqa: ARG002 - the interface's
        """Return the measured voltage of each output. Real-time safe."""
        wired = self._wired
        if not wired.inputs:
            return wired.measured()
        return self._newest(wired.measuring, len(wired.inputs))

    def close(self) -> None:
        """Do nothing: the card's own close cancels its commands."""

    @property
    def _wired(self) -> "WiredCard":
        return self._dialogue.wired

    def _commands(self) -> list[list[Pin]]:
        """Return the channels of each command: of the outputs, and of the inputs if there are."""
        wired = self._wired
        outputs = [pin for pin, _ in wired.outputs]
        if not wired.inputs:
            return [outputs]
        return [outputs, [pin for pin, _ in (*wired.inputs, *wired.measuring)]]

    def _require_commands(self, subdevice: int) -> None:
        if not self._wired.card.flags(subdevice) & (names.COMMAND_READ | names.COMMAND_WRITE):
            raise DeviceError("this card has no clock for its inputs or outputs: it cannot play")

    def _width(self, pins: "Sequence[Pin]") -> int:
        """Return the number of bytes of a code."""
        long = self._wired.card.flags(pins[0].subdevice) & names.LONG_SAMPLES
        return 4 if long else 2

    def _step_ns(self, pins: list[Pin], shortest_ns: int) -> int:
        """Return the step of the intervals: the first one that differs from the shortest."""
        more_ns = 1
        while more_ns < _LARGEST_STEP_NS:
            found = self._wired.card.test(pins, Timing(shortest_ns + more_ns, 2))
            if found.interval_ns > shortest_ns:
                return found.interval_ns - shortest_ns
            more_ns *= 2
        return more_ns

    def _fill(self) -> None:
        """Put as many points into the buffer as fit. Real-time safe."""
        out, card = self._out, self._wired.card
        while data := out.next():
            n = card.put(data)
            if not n:
                return
            out.took(n)

    def _cycle(self, table: Table) -> int:
        outputs = self._wired.outputs
        scan_bytes = len(outputs) * self._out_width
        waiting = self._wired.card.waiting_bytes(outputs[0].pin.subdevice)
        n_played = (self._out.n_sent - waiting) // scan_bytes
        return max(n_played - len(table.lead_in) - 1, 0) // len(table.period)

    def _failed(self, table: Table, reason: str) -> Progress:
        return Progress(PlayState.FAILED, self._cycle(table), reason)

    def _cancel(self) -> None:
        for pins in self._commands():
            self._wired.card.cancel(pins[0].subdevice)

    def _newest(self, channels: "Sequence[WiredPin]", first: int) -> list[float]:
        scan, width = self._in.newest, self._in_width
        if not scan:
            return [nan] * len(channels)
        return [
            converter.sample(
                int.from_bytes(scan[(first + i) * width : (first + i + 1) * width], "little")
            )
            for i, (_, converter) in enumerate(channels)
        ]

    def _require_table(self) -> Table:
        if self._table is None:
            raise DeviceError("no table is loaded")
        return self._table
