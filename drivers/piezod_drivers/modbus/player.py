"""Plays a table on a LabJack: stream-outs drive the outputs, the stream records the inputs.

In each scan the inputs are sampled first, then the outputs get their next value: a sample precedes
the point of its own scan.
"""

from collections.abc import Callable, Sequence
from math import nan
from typing import Final

from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Wiring
from piezod.devices.player import (
    AtEnd,
    Check,
    PlayedRecord,
    PlayerCapabilities,
    PlayState,
    Progress,
    Table,
)
from piezod.errors import DeviceError
from piezod_drivers.modbus.profiles import labjack_stream as registers
from piezod_drivers.modbus.profiles.labjack_stream import InputScale
from piezod_drivers.modbus.register import Register
from piezod_drivers.modbus.stream_record import MOST_SCANS, StreamRecord
from piezod_drivers.modbus.stream_requests import StreamRequests
from piezod_drivers.modbus.stream_setup import StreamSetup

POINTS: Final = registers.OUT_MOST_BYTES // 2 - 1
CYCLES: Final = 500_000
"""The number of scans is counted by 32 bits."""
POLL_NS: Final = 100_000_000
"""Time between two requests during a play; they also feed the device's watchdog."""
ENDED_EARLY_NS: Final = 1_000_000_000
"""Longest wait for the last packet after the stream has ended."""
NEAR_V: Final = 0.05
"""Largest distance of an output from the end of the table, in V."""
_OTHER_SCALE: Final = 0.05
"""Largest difference between the first sample and the input before the start, as a share of the
range; more means that the scale of the samples is another one.
"""
_HALF_RANGE: Final = 32_768


class LabJackPlayer:
    """Implements `PlayDialogue`.

    Args:
        stream: The line from which the packets of the stream come.
        known: All registers of the device.
        take_outputs: Called with the outputs when a play has ended or was stopped.

    Attributes:
        setup: The registers of the stream.
    """

    def __init__(
        self,
        setup: StreamSetup,
        stream: Line,
        wiring: Wiring,
        known: Sequence[Register],
        take_outputs: Callable[[Sequence[float]], None],
    ) -> None:
        self.setup, self._stream, self._take_outputs = setup, stream, take_outputs
        self._plan = setup.plan
        by_name = {(each.role, each.channel): each for each in known}
        self._inputs = [by_name["input", name].address for name in wiring.inputs]
        outputs = [by_name["output", name] for name in wiring.outputs]
        self._outputs = [each.address for each in outputs]
        self._highest_v = [each.high for each in outputs]
        self._requests = StreamRequests(setup, self._outputs)
        self._table: Table | None = None
        self._pulses = False
        self._scales: list[InputScale] = []
        self._before_v: list[float] = []
        self._record = StreamRecord(max(len(self._inputs), 1), 0)
        self._in_force: Sequence[float] = ()
        self._polled_ns: int | None = None
        self._ended_ns: int | None = None

    def stop_found(self) -> bool:
        """Stop a stream that another process has left on these outputs; return whether one ran.

        Raises:
            DeviceError: If another stream makes the inputs unreadable.
        """
        if not self.setup.is_active():
            return False
        if self.setup.played_outputs().intersection(self._outputs):
            self.setup.stop()
            return True
        if self._inputs:
            raise DeviceError(
                "a stream of another program is running, so the inputs cannot be read: stop it"
            )
        return False

    def capabilities(self) -> PlayerCapabilities:
        """Return the capabilities; nothing is asked."""
        # Imported at the start, when this is asked: `load` comes long afterwards.
        from piezod_drivers.modbus import stream_arrays  # noqa: F401, PLC0415 - numpy

        n_channels = len(self._inputs) + len(self._outputs)
        lines = self._plan.pulse_lines if len(self._outputs) < registers.N_OUTS else 0
        return PlayerCapabilities(
            shortest_interval_ns=max(self._plan.shortest_ns, n_channels * self._plan.address_ns),
            interval_step_ns=registers.TICK_NS,
            longest_interval_ns=registers.LONGEST_TICKS * registers.TICK_NS,
            points=POINTS,
            points_shared=False,
            resolution=tuple(high / self._plan.n_steps for high in self._highest_v),
            cycles=CYCLES,
            replaces=False,
            record_points=MOST_SCANS if self._inputs else 0,
            records_with_play=True,
            lag_ns=len(self._inputs) * self._plan.address_ns,
            at_end=AtEnd.HOLDS,
            pulse_lines=lines,
            pulses_at=("time",) if lines else (),
        )

    def load(self, table: Table, check: Check) -> Table:
        """Load a table; return it with the steps of the converters.

        Raises:
            DeviceError: If a stream is running, or the device refuses.
        """
        from piezod_drivers.modbus import stream_arrays  # noqa: PLC0415 - numpy, see there

        if self.setup.is_active():
            raise DeviceError("a stream of another program is running: stop it")
        words, mask = stream_arrays.words_of(table)
        if words:
            self._require_time(table.interval_ns)
        columns = stream_arrays.columns_of(table)
        for i, (address, values) in enumerate(zip(self._outputs, columns, strict=True)):
            self.setup.load(i, address, values, len(table.period), check)
        self._requests.pulse(mask)
        if words:
            self.setup.make_outputs(mask)
            out, n_looped = len(self._outputs), len(table.period)
            self.setup.load(out, registers.DIO_STATE, words, n_looped, check, words=True)
        self._pulses = bool(words)
        self._table = stream_arrays.quantised(table, self._highest_v, self._plan.n_steps)
        return self._table

    def arm(self) -> None:
        """Set up the scans, and connect to the stream.

        Raises:
            DeviceError: If the device refuses, or the stream's port cannot be reached.
        """
        table = self._require_table()
        self._scales = [self.setup.scale(address // 2) for address in self._inputs]
        self._before_v = [self.setup.number(address, "float32") for address in self._inputs]
        n_outs = len(self._outputs) + self._pulses
        outs = [registers.OUT_IN_SCAN + i for i in range(n_outs)]
        n_scans = table.n_points
        channels = [*self._inputs, *outs]
        self.setup.configure(table.interval_ns, channels, len(self._inputs), n_scans)
        self._record = StreamRecord(max(len(self._inputs), 1), n_scans)
        if self._inputs:
            self._stream.open()

    def start(self) -> None:
        """Start the stream.

        Raises:
            DeviceError: If the device refuses.
        """
        self._polled_ns = self._ended_ns = None
        while self._inputs and self._stream.receive(0):
            pass  # packets of an earlier stream
        self.setup.write(registers.ENABLE, 1)

    def progress(self, now_ns: int) -> Progress:
        """Take the packets that have come, and ask the device now and then. Real-time safe."""
        record = self._record
        if self._inputs and not record.complete:
            try:
                record.add(self._stream.receive(0))
            except LineFault as fault:
                return self._failed(f"the stream is lost: {fault}")
            if record.failure:
                return self._failed(record.failure)
            if record.first and self._before_v:
                if what := self._other_scale():
                    return self._failed(what)
                self._before_v = []
        due = self._polled_ns is None or now_ns - self._polled_ns >= POLL_NS
        if not (due or record.complete):
            return Progress(PlayState.PLAYING, self._cycle())
        self._polled_ns = now_ns
        is_on, self._in_force = self._requests.poll()
        if is_on:
            return Progress(PlayState.PLAYING, self._cycle())
        return self._after_end(now_ns)

    def stop(self) -> Sequence[float]:
        """Stop the stream; return the outputs. Real-time safe.

        LabJack's own example reads an output while a stream-out drives it.
        """
        self._in_force = self._requests.stop()
        self._take_outputs(self._in_force)
        return self._in_force

    def recording(self, check: Check) -> PlayedRecord:
        """Return the record, which has come during the play; the device measures no outputs.

        Raises:
            DeviceError: If scans are missing that the device does not report as lost.
        """
        check()
        from piezod_drivers.modbus import stream_arrays  # noqa: PLC0415 - numpy, see there

        table, n_scans = self._require_table(), 0
        positions = stream_arrays.nothing(0)
        if self._inputs:
            n_scans = min(self._record.n_scans, MOST_SCANS)
            positions = stream_arrays.positions_of(self._record.kept, n_scans, self._scales)
        return PlayedRecord(table.interval_ns, positions, 0, stream_arrays.nothing(n_scans))

    def sample(self, now_ns: int) -> Reading:
        """Return the newest scan, NaN before the first one. Real-time safe."""
        return now_ns, self._record.newest_v(self._scales) or [nan] * len(self._inputs)

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Return the value of each output. Real-time safe."""
        if self._polled_ns != now_ns:
            self._polled_ns = now_ns
            _, self._in_force = self._requests.poll()
        return self._in_force

    def close(self) -> None:
        """Disconnect from the stream. Never raises."""
        self._stream.close()

    def _after_end(self, now_ns: int) -> Progress:
        """Return the progress when the device streams no more."""
        table = self._require_table()
        if self._record.complete or not self._inputs:
            last_v = table.period[-1].tolist()
            if all(
                abs(v - end_v) < NEAR_V for v, end_v in zip(self._in_force, last_v, strict=True)
            ):
                self._take_outputs(self._in_force)
                return Progress(PlayState.ENDED, table.cycles)
            # The watchdog has tripped, or another program has set an output.
            return self._failed(
                f"the outputs are at {self._in_force} V, and not at the table's end"
            )
        if self._ended_ns is None:
            self._ended_ns = now_ns
        if now_ns - self._ended_ns > ENDED_EARLY_NS:
            return self._failed("the stream has ended before its last scan")
        return Progress(PlayState.PLAYING, self._cycle())

    def _cycle(self) -> int:
        table = self._require_table()
        return max(self._record.n_scans_done - len(table.lead_in), 0) // len(table.period)

    def _failed(self, reason: str) -> Progress:
        return Progress(PlayState.FAILED, self._cycle(), reason)

    def _other_scale(self) -> str:
        """Return why the scale of the samples cannot be right; empty if it can."""
        first_v = self._record.first_v(self._scales)
        for value_v, before_v, scale in zip(first_v, self._before_v, self._scales, strict=True):
            range_v = _HALF_RANGE * scale.above
            if abs(before_v) < range_v and abs(value_v - before_v) > _OTHER_SCALE * range_v:
                return (
                    f"the first sample is {value_v:.3f} V, and the input was {before_v:.3f} V "
                    "before the start: the samples have another scale"
                )
        return ""

    def _require_time(self, interval_ns: int) -> None:
        """Refuse an interval in which the digital outputs have no time."""
        channels = len(self._inputs) + len(self._outputs) + 1
        least_ns = max(self._plan.shortest_ns, channels * self._plan.address_ns)
        if interval_ns < least_ns:
            raise DeviceError(
                f"with pulses {channels} channels need {least_ns / 1000:g} µs for each point, the "
                f"table has {interval_ns / 1000:g} µs: choose a longer interval"
            )

    def _require_table(self) -> Table:
        if self._table is None:
            raise DeviceError("no table is loaded")
        return self._table
