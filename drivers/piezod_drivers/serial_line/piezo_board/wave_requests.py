"""The exchanges of a play on a player board."""

from collections.abc import Sequence
from typing import Final, Protocol

from piezod.devices.bus.dialogue import Reading
from piezod.devices.player import Check, EdgeWaits, SeenEdge
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.piezo_board import codec
from piezod_drivers.serial_line.piezo_board.codec import ROWS, BoardStatus
from piezod_drivers.serial_line.piezo_board.identity import BoardFacts
from piezod_drivers.serial_line.piezo_board.options import BoardOptions

_SLACK_NS: Final = 250_000_000
"""Longer than a board waits for data that do not come."""
_BITS: Final = 10
SPARE_EDGES: Final = 16
"""Edges that come too often, and are stored."""
_EDGE_WORDS: Final = 2
_STARTS: Final = {"command": "G", "start edge": "G start", "step edges": "G step"}


class PlayHost(Protocol):
    """What a player uses of the dialogue."""

    options: BoardOptions
    inputs: list[int]  #: Indices of the channels of the inputs.
    outputs: list[int]  #: Indices of the channels of the outputs.

    @property
    def facts(self) -> BoardFacts:
        """What the board is."""
        ...

    def ask_status(self, words: str) -> BoardStatus:
        """Send a request and return the status that answers it. Real-time safe."""
        ...

    def ask_words(self, words: str) -> str:
        """Send a request and return the words that answer it. Real-time safe."""
        ...

    def ask_data(self, words: str, data: bytes, n_back: int, timeout_ns: int) -> bytes:
        """Exchange a line and binary data; return the frame of the reply."""
        ...

    def reading(self, status: BoardStatus, now_ns: int) -> Reading:
        """Return the inputs of a status, in V. Real-time safe."""
        ...

    def input_volts(self, code: int) -> float:
        """Return the voltage of an input's code, NaN at the ends. Real-time safe."""
        ...

    def in_force_volts(self, status: BoardStatus) -> list[float]:
        """Return the outputs of a status, in V. Real-time safe."""
        ...


class WaveRequests:
    """Writes tables, starts and stops plays, reads records.

    All methods raise `LineFault` if the board does not reply, or refuses.
    """

    def __init__(self, host: PlayHost) -> None:
        self._host = host

    def write_table(self, codes: Sequence[int], check: Check) -> int:
        """Write the codes of all rows, row by row; return their CRC."""
        per_part = ROWS * self._host.facts.channels
        for first in range(0, len(codes), per_part):
            check()
            part = codes[first : first + per_part]
            n_rows = len(part) // self._host.facts.channels
            data = codec.with_crc(codec.data_bytes(part))
            words = f"T {first // self._host.facts.channels} {n_rows}"
            self._host.ask_data(words, data, 0, self._within_ns(len(data)))
        return codec.crc_of(codec.data_bytes(codes))

    def prepare(
        self, lines: str, n_rows: tuple[int, int], cycles: int, ticks: int, crc: int
    ) -> int:
        """Prepare a play; return the number of its point at which the record begins.

        Args:
            lines: Request for its pulses.
            n_rows: Rows of lead-in and period.
            cycles: Number of periods.
            ticks: Ticks between two points.
            crc: CRC of the table.
        """
        lead, period = n_rows
        # The record has the memory that the table leaves; what counts of a play is its end.
        first = max(lead + period * cycles - self.room(lead + period), 0)
        self._host.ask_status(lines)
        self._host.ask_status(f"P {lead} {period} {cycles} {ticks} {first} {crc:04X}")
        return first

    def wait_for(self, edges: EdgeWaits | None) -> None:
        """Let plays that are prepared from now on wait for edges; None for nowhere."""
        if self._host.facts.waits:
            first, every, times = (0, 1, 0) if edges is None else edges[:3]
            self._host.ask_status(f"E {first} {every} {times}")

    def edges(self) -> list[int]:
        """Return how many edges were seen, how many stored, whether it waits. Real-time safe."""
        return self._numbers("K", 3)

    def stored_edges(self, check: Check) -> tuple[SeenEdge, ...]:
        """Return the edges that are stored."""
        found = list[SeenEdge]()
        for k in range(self.edges()[1]):
            check()
            us, used = self._numbers(f"K {k}", 2)
            found.append(SeenEdge(1000 * us, bool(used)))
        return tuple(found)

    def edge_rows(self, edges: EdgeWaits) -> int:
        """Return the rows of the memory that the times of edges take."""
        return -(-(edges.times + SPARE_EDGES) * _EDGE_WORDS // self._host.facts.channels)

    def _numbers(self, words: str, n: int) -> list[int]:
        return codec.numbers_of(self._host.ask_words(words), "K", n)

    def start(self, edges: EdgeWaits | None) -> None:
        """Start the play, or let an edge start it; one that waits for edges starts at once."""
        self._host.ask_status("G" if edges else _STARTS[self._host.options.play_on])

    def recorded(self, n_rows: int, check: Check) -> list[int]:
        """Return the recorded codes, row by row."""
        channels, codes = self._host.facts.channels, list[int]()
        while len(codes) < n_rows * channels:
            check()
            first = len(codes) // channels
            n = min(ROWS, n_rows - first)
            n_back = 2 * n * channels + 2
            frame = self._host.ask_data(f"R {first} {n}", b"", n_back, self._within_ns(n_back))
            codes += codec.data_of(frame)
        return codes

    def room(self, n_table: int) -> int:
        """Return the number of samples that a record has beside a table of so many rows."""
        return self._host.facts.memory - n_table

    def _within_ns(self, n_bytes: int) -> int:
        """Return the time-out for binary data, in ns: twice their time, and some."""
        return _SLACK_NS + 2 * n_bytes * _BITS * NS_PER_S // self._host.options.baud
