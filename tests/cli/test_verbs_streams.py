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
from tests.client.fake_daemon import Document, FakeDaemon, events, interval


def telemetry(document: Document) -> Telemetry:
    """Return the telemetry of a document."""
    reader = TelemetryReader()
    (read,) = filter(None, map(reader.feed, events([document]).decode().splitlines()))
    return read


def shown(document: Document, ranges: dict[str, AxisRanges], width: int = 100) -> str:
    """Return the view of `watch`, without colours."""
    console = Console(file=io.StringIO(), width=width, color_system=None)
    console.print(view(telemetry(document), ranges, 1000.0))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


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
    """On a terminal the view stays in place."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    daemon.telemetry = [interval(1.0), interval(2.0, t_s=100.05)]

    _, out, _ = piezod("watch")

    assert "1.000" in out
    assert "2.000" in out
    assert "1000 Hz" in out


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

    text = shown(interval(12.4), ranges)

    assert "RUN   1000 Hz, 3 skipped cycles" in text
    assert "adaptive" in text
    assert " ".join(text.split()).count("12.400") == 1
    assert "60.00" in text
    assert "━" in text
    assert "no fault" in text


def test_view_of_faults() -> None:
    """The view names faults; an unknown value has no bar."""
    text = shown(interval(None, state="FAULT", faults=["S5"]), {})

    assert "FAULT" in text
    assert "–" in text
    assert "━" not in text
    assert "faults S5: `piezod faults` shows more" in text


def test_view_shows_that_nothing_is_written() -> None:
    """The view says that the stage is in shadow mode."""
    assert "in shadow: nothing is written" in shown({**interval(), "shadow": True}, {})


def test_view_fits_into_80_columns() -> None:
    """The view fits into 80 columns."""
    ranges = {"x": AxisRanges((0.0, 24.8), (0.0, 120.0))}

    text = shown(interval(12.4), ranges, width=80)

    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text


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
