"""The emulated board: the compiled firmware in simavr, with the rig behind its converters."""

from math import isfinite
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator, EmulatorPlugin
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.piezo_board.emulation.build import Built, build
from piezod_drivers.serial_line.piezo_board.emulation.simavr import CLOCK_HZ, Processor

CODES: Final = 65_535
"""Code of the highest voltage of a converter; by itself, not from the driver."""
V_PER_CODE: Final = 150.0 / CODES
"""An output of 0 to 5 V is 0 to 150 V at the actuator."""
UM_PER_CODE: Final = 40.0 / CODES
LOWEST_UM: Final = -5.0
"""An input of 0 to 5 V is a displacement of -5 to 35 µm."""
AHEAD_NS: Final = 200_000_000
"""Longest time that a board may take for what came to it, before it is interrupted."""
_NS_PER_CYCLE: Final = NS_PER_S / CLOCK_HZ


class BoardEmulator(Emulator):
    """A board that was just switched on; its time is that of the rig.

    While it has something to do, it may be some milliseconds ahead of the rig's clock.

    Args:
        bench: The rig; its axes are the channels.
        name: Name of the board, "" for its default.
        built: The compiled board; None for that of piezod.

    Attributes:
        processor: The processor.
    """

    def __init__(self, bench: SharedRig, name: str, built: Built | None = None) -> None:
        self._bench = bench
        self._codes: list[int | None] = [None] * bench.n_axes
        built = built or build(defines=f"-DPORT_CHANNELS={bench.n_axes}")
        self._begin_ns, self._played = bench.start_ns(), False
        self.processor = Processor(built, name or "emulated", self._drive, self._sense)
        bench.plays_from(None)

    @property
    def pulses(self) -> tuple[int, int, int]:
        """Pulses of points, lines and frames so far."""
        seen = self.processor.seen
        return seen.points, seen.lines, seen.frames

    def receive(self, data: bytes) -> list[bytes]:
        """Let the firmware take bytes, and return what it sends."""
        self._run_to(self._bench.now_ns())
        self.processor.feed(data)
        end_ns = max(self._bench.now_ns(), self._ns_of(self.processor.cycle)) + AHEAD_NS
        self.processor.run(self._cycle_of(end_ns), until_idle=True)
        return self._sent()

    def due(self) -> list[bytes]:
        """Let the firmware run until now, and return what it sends."""
        self._run_to(self._bench.now_ns())
        return self._sent()

    def _run_to(self, t_ns: int) -> None:
        self.processor.run(self._cycle_of(t_ns))

    def _sent(self) -> list[bytes]:
        # The clock of the rig waits for a board that plays.
        at_ns = self._ns_of(self.processor.cycle)
        self._bench.plays_from(at_ns if self.processor.plays else None)
        sent = self.processor.take()
        return [sent] if sent else []

    def _drive(self, channel: int, code: int, cycle: int) -> None:
        if channel < self._bench.n_axes and code != self._codes[channel]:
            self._codes[channel] = code
            self._bench.drive(channel, code * V_PER_CODE, self._ns_of(cycle))

    def _sense(self, channel: int, cycle: int) -> int:
        if channel >= self._bench.n_axes:
            return 0
        if self.processor.plays and not self._played:
            # The points of all plays have the same place between two steps of the physics.
            self._begin_ns += self._bench.aligned_ns(self._ns_of(cycle)) - self._ns_of(cycle)
        self._played = self.processor.plays
        position_um = self._bench.positions_um(self._ns_of(cycle))[channel]
        if not isfinite(position_um):
            return CODES
        return max(0, min(round((position_um - LOWEST_UM) / UM_PER_CODE), CODES))

    def _ns_of(self, cycle: int) -> int:
        return self._begin_ns + round(cycle * _NS_PER_CYCLE)

    def _cycle_of(self, t_ns: int) -> int:
        return max(round((t_ns - self._begin_ns) / _NS_PER_CYCLE), 0)


EMULATOR: Final = EmulatorPlugin(
    name="board",
    summary="player board: its compiled firmware in simavr, 40 µm, 0 to 150 V",
    wire="serial",
    create=BoardEmulator,
)
