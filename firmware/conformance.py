"""Checks whether a board speaks the protocol of `docs/board-protocol.md`.

    python firmware/conformance.py /dev/serial/by-id/EXAMPLE

Needs Python 3.11 and pyserial, and nothing of piezod. Each check prints a line; the exit code is 0
if all pass. Outputs move through their whole range: connect no stage. It takes some ten seconds.
"""

import struct
import sys
import time
from binascii import crc_hqx
from collections.abc import Callable
from typing import Final, NamedTuple, Protocol


class Port(Protocol):
    """The line to a board."""

    def write(self, data: bytes) -> object:
        """Send bytes."""
        ...

    def read(self, most: int) -> bytes:
        """Return up to so many bytes, fewer if they do not come within a second."""
        ...

    def wait(self, seconds: float) -> None:
        """Let time pass without a request."""
        ...


class Failure(Exception):  # noqa: N818 - the word of the reports
    """Raised if a board does something else than the protocol says."""


class Status(NamedTuple):
    """The reply that reports the state."""

    state: str
    flags: str
    outputs: list[int]
    inputs: list[int]
    cycle: int
    kept: int


class Board:
    """A board, asked over its port.

    Args:
        port: The line.

    Attributes:
        facts: What the board says of itself.
    """

    def __init__(self, port: Port) -> None:
        self._port, self._tag = port, 0
        self.facts: dict[str, str] = {}
        self.channels = 1

    def lines(self, raw: bytes) -> str:
        """Send bytes as they are; return the next line."""
        self._port.write(raw)
        return self._line()

    def ask(self, words: str) -> str:
        """Send a request with a tag and a checksum; return the words of its reply."""
        return self.send(checked(self.tagged(words)).encode() + b"\n")

    def tagged(self, words: str) -> str:
        """Return a request with a new tag."""
        self._tag = (self._tag + 1) % 0xFFF
        return f"@{self._tag:x} {words}"

    def send(self, data: bytes) -> str:
        """Send bytes; return the words of the reply, whose tag and checksum are right."""
        self._port.write(data)
        return self.answer()

    def answer(self) -> str:
        """Return the words of the next reply."""
        line, tag = self._line(), f"@{self._tag:x} "
        expect(line.startswith(tag), f"{line!r} does not begin with the tag {tag!r}")
        text, _, _ = line.rpartition("*")
        expect(line == checked(text), f"{line!r} has no checksum, or a wrong one")
        return text.removeprefix(tag)

    def status(self, words: str = "?") -> Status:
        """Send a request and return the state that answers it."""
        reply = self.ask(words)
        parts = reply.split(" ")
        n = self.channels
        well = parts[0] == "S" and len(parts) == 5 + 2 * n
        expect(well, f"{words!r} was answered {reply!r}, not with a state of {n} channels")
        numbers = [int(part) for part in parts[3:]]
        return Status(parts[1], parts[2], numbers[:n], numbers[n : 2 * n], numbers[-2], numbers[-1])

    def refuses(self, words: str, reason: str) -> None:
        """Send a request that must be refused."""
        reply = self.ask(words)
        expect(reply == f"E {reason}", f"{words!r} was answered {reply!r}, not E {reason}")

    def load(self, rows: list[int], first: int = 0) -> int:
        """Write rows of a table, all channels alike; return their checksum."""
        values = [value for row in rows for value in [row] * self.channels]
        data = struct.pack(f"<{len(values)}H", *values)
        per_part = 128 * 2 * self.channels
        for begin in range(0, len(data), per_part):
            part = data[begin : begin + per_part]
            at, n = first + begin // (2 * self.channels), len(part) // (2 * self.channels)
            expect(self.ask(f"T {at} {n}") == "T go", f"a table of {n} rows is not taken")
            expect(self.send(with_crc(part)) == "T ok", "right data are refused")
        return crc(data)

    def record(self, first: int, n: int) -> list[int]:
        """Return the first channel of some rows of the record."""
        expect(self.ask(f"R {first} {n}") == f"R {first} {n}", "the record is not sent")
        data = self._port.read(2 * n * self.channels + 2)
        expect(data == with_crc(data[:-2]), "the checksum of the record is wrong")
        return list(struct.unpack(f"<{n * self.channels}H", data[:-2])[:: self.channels])

    def wait(self, seconds: float) -> None:
        """Let time pass without a request."""
        self._port.wait(seconds)

    def wait_for_end(self) -> Status:
        """Return the state after the end of a play."""
        for _ in range(100):
            if (found := self.status()).state != "play":
                return found
            self.wait(0.05)
        raise Failure("a play does not end")

    def on(self, *counts: int) -> Status:
        """Take control, without a watchdog, and set the outputs."""
        self.status("OFF")
        self.status("W 0")
        self.status("ON")
        return self.status("V " + " ".join(map(str, counts or [self.middle] * self.channels)))

    @property
    def middle(self) -> int:
        """A count in the middle of the range."""
        return (int(self.facts["lowest"]) + int(self.facts["highest"])) // 2

    @property
    def wave(self) -> list[int]:
        """A table of 100 rows around the middle, without two equal neighbours."""
        low, high = int(self.facts["lowest"]), int(self.facts["highest"])
        return [low + (high - low) * (20 + min(i, 100 - i)) // 90 for i in range(100)]

    def _line(self) -> str:
        line = b""
        while not line.endswith(b"\n"):
            byte = self._port.read(1)
            if not byte:
                raise Failure(f"no reply, after {line!r}")
            line += byte
        return line.decode("ascii", "replace")[:-1]


def crc(data: bytes) -> int:
    """Return CRC-16/CCITT-FALSE."""
    return crc_hqx(data, 0xFFFF)


def checked(text: str) -> str:
    """Return a line with its checksum."""
    return f"{text}*{crc(text.encode()):04X}"


def with_crc(data: bytes) -> bytes:
    """Return data with their checksum."""
    return data + struct.pack("<H", crc(data))


def expect(holds: bool, what: str) -> None:
    """Raise `Failure` unless something holds."""
    if not holds:
        raise Failure(what)


def identity(board: Board) -> None:
    """It says what it is."""
    reply = board.ask("I")
    expect(reply.startswith("I piezod-player "), f"it says {reply!r}")
    board.facts = dict(part.partition("=")[::2] for part in reply.split(" ")[2:])
    needed = "board firmware name protocol channels memory clock shortest longest lowest highest"
    for key in (*needed.split(), "safe"):
        expect(key in board.facts, f"its identity lacks {key}")
    expect(board.facts["protocol"] == "1", f"its protocol is {board.facts['protocol']}")
    board.channels = int(board.facts["channels"])


def control(board: Board) -> None:
    """Setpoints are refused before ON, and in force afterwards; OFF leaves the safe value."""
    board.status("OFF")
    counts = " ".join([str(board.middle)] * board.channels)
    board.refuses(f"V {counts}", "off")
    expect(board.on().outputs == [board.middle] * board.channels, "a setpoint is not in force")
    expect(board.status().state == "on", "it is not on after ON")
    board.status("OFF")
    board.wait(1.0)
    safe = [int(board.facts["safe"])] * board.channels
    expect(board.status().outputs == safe, "OFF does not lead to the safe value within 1 s")


def nonsense(board: Board) -> None:
    """What is no request changes nothing, and the reason is told."""
    before = board.on().outputs
    count = " ".join([str(board.middle + 1)] * board.channels)
    for words, reason in (
        (f"V {count}x", "syntax"), (f"V {count} 1", "syntax"), ("V", "syntax"), ("V -1", "syntax"),
        (" ".join(["V", *["65536"] * board.channels]), "range"),
        ("Q", "unknown"), ("G x", "syntax"),
        ("R 0 60000", "memory"), ("T 0 129", "memory"), (f"T {board.facts['memory']} 1", "memory"),
    ):  # fmt: skip
        board.refuses(words, reason)
    reply = board.lines(b"x" * 90 + b"\n")
    expect(reply.startswith("E "), f"a line of 90 characters was answered {reply!r}")
    expect(board.status().outputs == before, "nonsense has moved an output")


def checksums(board: Board) -> None:
    """A wrong checksum, and a missing one once there were some, changes nothing."""
    before = board.on().outputs
    words = board.tagged("V " + " ".join([str(board.middle + 1)] * board.channels))
    for line in (f"{words}*{crc(words.encode()) ^ 1:04X}", words, f"{words}*"):
        reply = board.lines(line.encode() + b"\n")
        expect(" E crc" in reply, f"{line!r} was answered {reply!r}")
    expect(board.status().outputs == before, "a line with a wrong checksum has moved an output")


def tables(board: Board) -> None:
    """Data are refused if their checksum is wrong, if they end early, or if the table differs."""
    board.on()
    data = struct.pack(f"<{board.channels}H", *[board.middle] * board.channels)
    board.ask("T 0 1")
    reply = board.send(data + struct.pack("<H", crc(data) ^ 1))
    expect(reply == "E crc", f"data with a wrong checksum were answered {reply!r}")
    board.ask("T 0 2")
    reply = board.send(data)
    expect(reply == "E short", f"half of the data was answered {reply!r}")
    expect(board.status().state == "on", "it does not answer after half of the data")
    sum_ = board.load(board.wave)
    shortest = int(board.facts["shortest"])
    board.refuses(f"P 0 100 1 {shortest} 0 {sum_ ^ 1:04X}", "table")
    board.refuses("G", "table")
    board.refuses(f"P 0 100 1 {shortest - 1} 0 {sum_:04X}", "range")
    board.refuses(f"P 0 100 0 {shortest} 0 {sum_:04X}", "range")
    board.refuses(f"P 1 {board.facts['memory']} 1 {shortest} 0 {sum_:04X}", "memory")


def play(board: Board) -> None:
    """A play ends after its cycles, at the last row; the record has every point from the first."""
    board.on()
    sum_ = board.load(board.wave)
    n, cycles = 20, 5
    board.status(f"P {n} {100 - n} {cycles} {board.facts['shortest']} 0 {sum_:04X}")
    expect(board.status("G").state in {"play", "on"}, "a play does not start")
    found = board.wait_for_end()
    points = n + cycles * (100 - n)
    expect(found.cycle == cycles, f"{found.cycle} cycles were played, not {cycles}")
    expect(found.kept == points, f"{found.kept} points were recorded, not {points}")
    expect(found.outputs[0] == board.wave[-1], "the output is not the last row after a play")
    expect("l" not in found.flags, "a point was late at the shortest interval")
    rows = [value for first in range(0, points, 128)
            for value in board.record(first, min(128, points - first))]  # fmt: skip
    expect(len(rows) == points, "the record has not all points")
    board.refuses(f"R {points} 1", "memory")
    board.status(f"P {n} {100 - n} {cycles} {board.facts['shortest']} {points - 7} {sum_:04X}")
    board.status("G")
    found = board.wait_for_end()
    expect(found.kept == 7, f"a record from the seventh point before the end has {found.kept}")


def edges(board: Board) -> None:
    """A play holds its outputs where it waits for an edge."""
    if board.facts.get("edges") != "1":
        return
    sum_ = board.load(board.wave)
    board.on()
    board.refuses("E 10 0 1", "range")
    board.status("E 10 1 1")
    board.status(f"P 0 100 1 {board.facts['longest']} 0 {sum_:04X}")
    board.status("G")
    for _ in range(100):
        if board.ask("K") == "K 0 0 1":
            break
        board.wait(0.05)
    board.wait(0.1)
    found = board.status()
    expect(board.ask("K") == "K 0 0 1", "a play does not wait for an edge")
    expect(found.state == "play" and found.outputs[0] == board.wave[9], "it waits elsewhere")
    board.refuses("K 0", "memory")
    board.status("A")
    board.status("E 0 1 0")


def stop(board: Board) -> None:
    """A play refuses setpoints and tables; a stop holds the value that is in force."""
    board.on()
    sum_, longest = board.load(board.wave), int(board.facts["longest"])
    board.status(f"P 0 100 1000000 {longest} 0 {sum_:04X}")
    board.status("G")
    board.wait(10 * longest / int(board.facts["clock"]))
    board.refuses("V " + " ".join([str(board.middle)] * board.channels), "busy")
    board.refuses("T 0 1", "busy")
    board.refuses("G", "busy")
    found = board.status("A")
    expect(found.state == "on", "it is not on after a stop")
    expect(found.kept >= 5, "it did not play")
    row = (found.kept - 1) % 100
    expect(found.outputs[0] == board.wave[row], "a stop does not hold the point in force")
    expect(board.status().outputs == found.outputs, "the output moves after a stop")


def watchdog(board: Board) -> None:
    """A silent host ends in the safe value, also in a play; requests keep the watchdog quiet."""
    safe = [int(board.facts["safe"])] * board.channels
    sum_, clock = board.load(board.wave), int(board.facts["clock"])
    for plays in (False, True):
        board.on()
        board.status("W 200")
        if plays:
            longest = min(int(board.facts["longest"]), clock // 1000)
            board.status(f"P 0 100 1000000 {longest} 0 {sum_:04X}")
            board.status("G")
        for _ in range(5):
            board.wait(0.1)
            expect(board.status().state != "off", "the watchdog trips although the host is there")
        board.wait(1.5)
        found = board.status()
        expect(found.state == "off", f"it is {found.state} after 1.5 s of silence, not off")
        expect("w" in found.flags, f"its flags are {found.flags!r} without w")
        expect(found.outputs == safe, f"its outputs are {found.outputs}, not {safe}")
        board.refuses("V " + " ".join([str(board.middle)] * board.channels), "off")
    expect(board.status("ON").flags == "-", "ON does not clear the flags")
    board.status("OFF")


CHECKS: Final[tuple[Callable[[Board], None], ...]] = (
    identity, control, nonsense, checksums, tables, play, edges, stop, watchdog,
)  # fmt: skip


def failures(port: Port, report: Callable[[str], None] = print) -> list[str]:
    """Run all checks; return what failed.

    Args:
        port: The line to the board.
        report: Receives a line for each check.
    """
    board, failed = Board(port), []
    for check in CHECKS:
        what = (check.__doc__ or "").strip()
        try:
            check(board)
        except (Failure, ValueError, struct.error) as failure:
            report(f"FAIL {what} {failure}")
            failed.append(f"{check.__name__}: {failure}")
            if check is identity:
                break
        else:
            report(f"ok   {what}")
    return failed


def main() -> None:
    """Check the board at a port."""
    import serial  # noqa: PLC0415 - tests bring another port

    class SerialPort(serial.Serial):
        def wait(self, seconds: float) -> None:
            time.sleep(seconds)

    if len(sys.argv) != 2:
        sys.exit("give the port of the board, and nothing else")
    with SerialPort(sys.argv[1], 500_000, timeout=1.0) as port:
        port.write(b"\n")
        port.wait(0.3)
        port.reset_input_buffer()
        sys.exit(1 if failures(port) else 0)


if __name__ == "__main__":
    main()
