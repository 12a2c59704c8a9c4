"""`piezod watch` and `piezod stream`, and the completion of the shell."""

import io
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from rich.console import Console

from piezod.cli.interrupt import Interrupted
from piezod.cli.look.sparkline import BLOCKS, History, Sparkline, blocks_of
from piezod.cli.look.watch_view import AxisRanges, LoopRate, WatchView, ranges_of
from piezod.client import StageClient
from piezod.client.reader import TelemetryReader
from piezod.messages.answers import Fault
from piezod.messages.telemetry import Telemetry
from tests.cli.conftest import Command
from tests.client.fake_daemon import Document, FakeDaemon, events, interval, ranged


def telemetry(document: Document) -> Telemetry:
    """Return the telemetry of a document."""
    reader = TelemetryReader()
    (read,) = filter(None, map(reader.feed, events([document]).decode().splitlines()))
    return read


def shown(
    *documents: Document,
    ranges: dict[str, AxisRanges] | None = None,
    faults: Sequence[Fault] = (),
    width: int = 80,
) -> str:
    """Return the view of `watch` after some intervals, without colours."""
    console = Console(file=io.StringIO(), width=width, color_system=None)
    watched = WatchView("bench", ranges or {})
    for document in documents:
        view = watched.update(telemetry(document), faults)
    console.print(view)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def line_of(text: str, word: str) -> str:
    """Return the only line of a text that begins with a word."""
    (line,) = (line for line in text.splitlines() if line.startswith(word))
    return line.rstrip()


def test_watch_as_json(piezod: Command, daemon: FakeDaemon) -> None:
    """Each interval is one line of JSON; the end of the daemon is an error."""
    daemon.telemetry = [interval(1.0), interval(2.0)]

    code, out, err = piezod("watch", "--json", "--rate", "20", "--axis", "x")

    assert (code, [json.loads(line) for line in out.splitlines()]) == (69, daemon.telemetry)
    assert "the daemon has ended" in err
    assert daemon.asked[0].what == "GET telemetry?rate_hz=20&axes=x"


def test_watch_without_a_terminal(piezod: Command, daemon: FakeDaemon) -> None:
    """In a pipe each interval is one line of text."""
    daemon.telemetry = [interval(), interval(None, state="FAULT", faults=["S5"])]

    _, out, _ = piezod("watch")

    assert out.splitlines() == [
        "RUN; x: 12.400 µm, error 0.100 µm, 60.00 V",
        "FAULT; x: – µm, error – µm, 60.00 V; faults S5",
    ]


def test_watch_on_a_terminal(
    piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a terminal the view has a screen of its own, and its last state stays."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    fault = {"id": "S5", "name": "no valid sample", "remedy": "plug the sensor in"}
    daemon.answers["GET faults"] = {"faults": [fault]}
    daemon.telemetry = [interval(1.0), *[interval(2.0, t_s=100.05, faults=["S5"])] * 3]

    _, out, _ = piezod("watch")

    during, _, after = out.partition("\x1b[?1049l")
    assert "1.000" in during
    assert "2.000" in after
    assert "plug the sensor in" in " ".join(after.split())
    assert [each.what for each in daemon.asked].count("GET faults") == 1


def test_watch_without_remedies(
    piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the daemon refuses to list the faults, watching goes on with their ids."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    daemon.refuse("GET faults", 429, "too_many", "too many requests")
    daemon.telemetry = [interval(1.0, faults=["S5"]), interval(2.0, faults=["S5"])]

    _, out, _ = piezod("watch")

    assert "`piezod faults` shows more" in out
    assert "2.000" in out


def test_watch_on_a_terminal_without_a_cursor(
    piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A terminal that cannot move its cursor gets a line per update, as a file does."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "dumb")
    daemon.telemetry = [interval(1.0), interval(2.0)]

    _, out, _ = piezod("watch")

    assert len(out.splitlines()) == 2


def test_ctrl_c_is_how_watching_ends(
    piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After Ctrl-C watch exits with 0."""

    def until_interrupted(*_: object) -> Iterator[Telemetry]:
        yield telemetry(interval())
        raise Interrupted

    monkeypatch.setattr(StageClient, "telemetry", until_interrupted)

    code, out, err = piezod("watch", "--json")

    assert (code, json.loads(out), err) == (0, interval(), "")
    assert daemon.asked == []


def test_view() -> None:
    """The view has all quantities, and bars for known ranges."""
    ranges = {"x": AxisRanges((0.0, 24.8), (0.0, 120.0))}

    text = shown(interval(12.3), interval(12.4, on_target=True, t_s=100.05), ranges=ranges)

    assert text.startswith("bench   RUN")
    assert "1000 Hz   late up to 20 µs   3 skipped, 0 of them in the last 30 s" in text
    assert line_of(text, "x ").split()[:4] == ["x", "adaptive", "on", "target"]
    assert "12.400 µm of 12.500 µm" in line_of(text, "position")
    assert "━" in line_of(text, "position")
    assert "0.100 µm up to 0.200 µm" in line_of(text, "error")
    assert "60.00 V 60.0 to 60.0 V" in line_of(text, "drive")
    assert "no fault" in text


def test_view_shows_the_last_half_minute() -> None:
    """The sparkline has the worst error of each part of 30 s; the newest is on the right."""
    ranges = {"x": AxisRanges(None, (0.0, 120.0))}
    past = [interval(12.5 - i / 100, t_s=100.0 + i) for i in range(60)]

    text = shown(*past, ranges=ranges)

    error, drive = line_of(text, "error"), line_of(text, "drive")
    assert error[-1] == "█"
    assert [block for block in error if block in BLOCKS] == sorted(
        block for block in error if block in BLOCKS
    )
    assert "0.590 µm up to 0.590 µm" in error
    assert set(drive.partition(" to 60.0 V")[2].strip()) <= {"▅", " "}  # half of the range


def test_view_counts_new_skipped_cycles() -> None:
    """Cycles that were skipped in the last half minute are counted apart."""
    skipping = {**interval(t_s=110.0), "skipped_cycles": 8, "late_max_us": 700.0}

    text = shown(interval(), skipping)

    assert "late up to 700 µs   8 skipped, 5 of them" in text


def test_view_of_faults() -> None:
    """The view names faults with their remedies; an unknown value has neither bar nor line."""
    faults = (Fault(id="S5", name="no valid sample", remedy="plug it in", present=False),)

    text = shown(interval(None, state="FAULT", faults=["S5", "A1"]), faults=faults)

    assert "FAULT" in text
    assert "– µm" in text
    assert "━" not in text
    assert not set(line_of(text, "error")) & set(BLOCKS)
    assert "S5 no valid sample (gone): plug it in" in text
    assert "A1: `piezod faults` shows more" in text


def test_view_shows_that_nothing_is_written() -> None:
    """The view says that the stage is in shadow mode."""
    assert "in shadow: nothing is written" in shown({**interval(), "shadow": True})


@pytest.mark.parametrize("width", [80, 60, 200])
def test_view_fits_into_the_terminal(width: int) -> None:
    """The view uses the width of the terminal, 80 columns and others."""
    ranges = {"x": AxisRanges((0.0, 24.8), (0.0, 120.0))}
    wide = interval(-1234.567)
    wide["axes"]["x"]["drive_v"] = ranged(-1000.0)

    text = shown(wide, ranges=ranges, width=width)

    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text


def test_history_forgets_and_keeps_its_columns() -> None:
    """Values older than 30 s are left out; a value stays in its column while time goes on."""
    history = History(max)
    for t_s, value in ((0.0, 9.0), (40.0, 1.0), (41.0, None), (55.0, 3.0), (55.2, 2.0)):
        history.add(t_s, value)

    assert history.range == (1.0, 3.0)
    assert history.columns(3) == [None, 1.0, 3.0]
    assert history.columns(30)[-1] == 3.0


def test_blocks() -> None:
    """The lowest value has the lowest block, values beyond the limits the last ones."""
    assert blocks_of([0.0, None, 7.0, 9.0, -1.0], 0.0, 7.0) == "▁ ██▁"
    assert blocks_of([4.0, 4.0], 4.0, 4.0) == "▁▁"


def test_terminal_without_unicode_has_other_blocks() -> None:
    """A terminal that has ASCII only gets a sparkline too."""
    history = History(max)
    history.add(1.0, 5.0)
    file = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    Console(file=file, width=10).print(Sparkline(history, low=0.0))
    file.seek(0)

    assert file.read().strip() == "#"


def test_ranges_of_a_configuration() -> None:
    """Bars have the range of commands and the drive limits of the configuration."""
    limits = {"drive_min_v": -20, "drive_max_v": 120}
    config = {"axes": {"x": {"command_range_um": [0, 26], "limits": limits}, "y": {}}}

    assert ranges_of(config) == {
        "x": AxisRanges((0, 26), (-20, 120)),
        "y": AxisRanges(None, None),
    }


def test_rate_is_that_of_the_loop() -> None:
    """The rate counts the cycles of an interval, with the lost ones."""
    rate = LoopRate()

    assert rate.hz(telemetry(interval())) is None
    assert rate.hz(telemetry({**interval(t_s=100.1), "lost": 50})) == pytest.approx(1000)


def test_stream(piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each line of stdin is a setpoint."""
    monkeypatch.setattr(sys, "stdin", io.StringIO('{"x": 1}\n\n{"x": 2.5}\n'))
    daemon.answers["POST stream"] = {"accepted": True, "setpoints": 2}

    assert piezod("stream") == (0, "2 setpoints followed, the stage holds\n", "")
    assert daemon.asked[0].body == [{"x": 1}, {"x": 2.5}]


@pytest.mark.parametrize("line", ["x: 1", "[1]", '{"x": "1"}', '{"x": true}', "{}"])
def test_stream_of_something_else(
    piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    """A line that is not a setpoint ends the stream with its number."""
    monkeypatch.setattr(sys, "stdin", io.StringIO(f'{{"x": 1}}\n{line}\n'))

    code, out, err = piezod("stream")

    assert (code, out) == (1, "")
    assert err == f'stdin:2: must be positions by axis, for example {{"x": 12.3}} (got {line})\n'
    assert daemon.asked == []


def test_stream_that_is_refused(
    piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A refused stream has the reason of the daemon."""
    monkeypatch.setattr(sys, "stdin", io.StringIO('{"x": 1}\n'))
    daemon.refuse("POST stream", 409, "refused", "the stage is SAFE", "piezod arm")

    assert piezod("stream") == (1, "", "the stage is SAFE; piezod arm\n")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_can_be_shown(
    process: Command, monkeypatch: pytest.MonkeyPatch, shell: str
) -> None:
    """The command prints the completion script of each shell."""
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")

    code, out, err = process("--show-completion", shell)

    assert (code, err) == (0, "")
    assert "_PIEZOD_COMPLETE" in out


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("piezod es", ["estop"]),
        ("piezod mode ad", ["adaptive"]),
        ("piezod params re", ["restore"]),
        ("piezod stop --stage b", ["bench"]),
        ("piezod goto 1 --axis ", ["x"]),
        ("piezod goto 1 --stage no --axis ", []),
        ("piezod record get 2026", ["20261121T120000Z"]),
    ],
)
def test_completion(
    piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch, words: str, found: object
) -> None:
    """Verbs, modes, running stages, axes and recordings are completed."""
    names = [{"name": "20261121T120000Z"}]
    daemon.answers["GET recordings"] = {"running": None, "recordings": names}
    folder = daemon.socket_path.parent / "piezod" / "bench"
    folder.mkdir(parents=True)
    (folder / "api.sock").symlink_to(daemon.socket_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(daemon.socket_path.parent))
    monkeypatch.setenv("_PIEZOD_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split(" ")) - 1))

    code, out, _ = piezod()

    assert (code, out.split()) == (0, found)


def test_completion_without_a_daemon(
    piezod: Command, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a daemon nothing is completed, and no error is printed."""
    monkeypatch.setenv("PIEZOD_SOCKET", str(folder / "none.sock"))
    monkeypatch.setenv("_PIEZOD_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "piezod goto 1 --axis ")
    monkeypatch.setenv("COMP_CWORD", "4")

    assert piezod() == (0, "\n", "")
