"""`piezod watch` and `piezod stream`, and the completion of the shell."""

import io
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console

from piezod.cli.interrupt import Interrupted
from piezod.cli.watch_view import AxisRanges, LoopRate, ranges_of, view
from piezod.client import StageClient
from piezod.client.telemetry import Telemetry, TelemetryReader
from tests.cli.conftest import Command
from tests.client.fake_daemon import Document, FakeDaemon, events, told


def telemetry(document: Document) -> Telemetry:
    """Return what a client makes of a document."""
    reader = TelemetryReader()
    (read,) = filter(None, map(reader.feed, events([document]).decode().splitlines()))
    return read


def shown(document: Document, ranges: dict[str, AxisRanges], width: int = 100) -> str:
    """Return what `watch` shows, without its colours."""
    console = Console(file=io.StringIO(), width=width, color_system=None)
    console.print(view(telemetry(document), ranges, 1000.0))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_watch_as_json(piezod: Command, daemon: FakeDaemon) -> None:
    """Each interval is a line; the end of the daemon is an error."""
    daemon.telemetry = [told(1.0), told(2.0)]

    code, out, err = piezod("watch", "--json", "--rate", "20", "--axis", "x")

    assert (code, [json.loads(line) for line in out.splitlines()]) == (69, daemon.telemetry)
    assert "the daemon has gone" in err
    assert daemon.asked[0].what == "GET telemetry?rate_hz=20&axes=x"


def test_watch_without_a_terminal(piezod: Command, daemon: FakeDaemon) -> None:
    """In a pipe each interval is a line for people."""
    daemon.telemetry = [told(), told(None, state="FAULT", faults=["S5"])]

    _, out, _ = piezod("watch")

    assert out.splitlines() == [
        "RUN; x: 12.400 µm, error 0.100 µm, 60.00 V",
        "FAULT; x: – µm, error – µm, 60.00 V; faults S5",
    ]


def test_watch_on_a_terminal(
    piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a terminal the view stays in place."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    daemon.telemetry = [told(1.0), told(2.0, t_s=100.05)]

    _, out, _ = piezod("watch")

    assert "1.000" in out
    assert "2.000" in out
    assert "1000 Hz" in out


def test_ctrl_c_is_how_watching_ends(
    piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who has seen enough has made no mistake."""

    def until_interrupted(*_: object) -> Iterator[Telemetry]:
        yield telemetry(told())
        raise Interrupted

    monkeypatch.setattr(StageClient, "telemetry", until_interrupted)

    code, out, err = piezod("watch", "--json")

    assert (code, json.loads(out), err) == (0, told(), "")
    assert daemon.asked == []


def test_view() -> None:
    """All quantities are there, with bars where their range is known."""
    ranges = {"x": AxisRanges((0.0, 24.8), (0.0, 120.0))}

    text = shown(told(12.4), ranges)

    assert "RUN   1000 Hz, 3 skipped cycles" in text
    assert "adaptive" in text
    assert " ".join(text.split()).count("12.400") == 1
    assert "60.00" in text
    assert "━" in text
    assert "no fault" in text


def test_view_of_faults() -> None:
    """Faults are named, and a value that is missing has no bar."""
    text = shown(told(None, state="FAULT", faults=["S5"]), {})

    assert "FAULT" in text
    assert "–" in text
    assert "━" not in text
    assert "faults S5: `piezod faults` tells more" in text


def test_view_shows_that_nothing_is_written() -> None:
    """A stage in shadow does not move, whatever the numbers say."""
    assert "in shadow: nothing is written" in shown({**told(), "shadow": True}, {})


def test_view_fits_into_80_columns() -> None:
    """Nothing is cut off on the narrowest usual terminal."""
    ranges = {"x": AxisRanges((0.0, 24.8), (0.0, 120.0))}

    text = shown(told(12.4), ranges, width=80)

    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text


def test_ranges_of_a_configuration() -> None:
    """Bars span the command's range and the drive's limits, where the configuration has them."""
    limits = {"drive_min_v": -20, "drive_max_v": 120}
    config = {"axes": {"x": {"command_range_um": [0, 26], "limits": limits}, "y": {}}}

    assert ranges_of(config) == {
        "x": AxisRanges((0, 26), (-20, 120)),
        "y": AxisRanges(None, None),
    }


def test_rate_is_that_of_the_loop() -> None:
    """Cycles between two intervals, those that were lost on the way included."""
    rate = LoopRate()

    assert rate.hz(telemetry(told())) is None
    assert rate.hz(telemetry({**told(t_s=100.1), "lost": 50})) == pytest.approx(1000)


def test_stream(piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines of stdin become setpoints."""
    monkeypatch.setattr(sys, "stdin", io.StringIO('{"x": 1}\n\n{"x": 2.5}\n'))
    daemon.answers["POST stream"] = {"accepted": True, "setpoints": 2}

    assert piezod("stream") == (0, "2 setpoints followed, the stage holds\n", "")
    assert daemon.asked[0].body == [{"x": 1}, {"x": 2.5}]


@pytest.mark.parametrize("line", ["x: 1", "[1]", '{"x": "1"}', '{"x": true}', "{}"])
def test_stream_of_something_else(
    piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    """A line that is no setpoint ends the stream, and is named."""
    monkeypatch.setattr(sys, "stdin", io.StringIO(f'{{"x": 1}}\n{line}\n'))

    code, out, err = piezod("stream")

    assert (code, out) == (1, "")
    assert err == f'stdin:2: must be positions by axis, as in {{"x": 12.3}} (got {line})\n'
    assert daemon.asked == []


def test_stream_that_is_refused(
    piezod: Command, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reason is the daemon's."""
    monkeypatch.setattr(sys, "stdin", io.StringIO('{"x": 1}\n'))
    daemon.refuse("POST stream", 409, "refused", "the stage is SAFE", "piezod arm")

    assert piezod("stream") == (1, "", "the stage is SAFE; piezod arm\n")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_can_be_shown(
    process: Command, monkeypatch: pytest.MonkeyPatch, shell: str
) -> None:
    """The shell's own script comes from the command."""
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
    """Verbs, modes, running stages, and the names that a stage has, are completed."""
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
    """Where nothing runs nothing is completed, and nothing is said."""
    monkeypatch.setenv("PIEZOD_SOCKET", str(folder / "none.sock"))
    monkeypatch.setenv("_PIEZOD_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "piezod goto 1 --axis ")
    monkeypatch.setenv("COMP_CWORD", "4")

    assert piezod() == (0, "\n", "")
