"""What each call asks for."""

import inspect
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from piezod.client import AsyncStageClient, StageClient, calls
from piezod.client.calls import Call
from piezod.client.results import Answer
from piezod.client.waveforms import tupled
from piezod.config.model_file import ModelFile, load_model
from piezod.config.waveforms import Points
from piezod.errors import RefusedError

ROOT = Path(__file__).parents[2]
SINE = {"kind": "sine", "low": 0, "high": 10.0, "frequency_hz": 1.0}


@pytest.mark.parametrize(
    ("call", "path", "body"),
    [
        (calls.arm(), "arm", {"shadow": False, "confirm_output": False}),
        (calls.disarm(), "disarm", {}),
        (calls.mode("adaptive"), "mode", {"mode": "adaptive"}),
        (calls.mode("trimmed", axis="y"), "mode", {"mode": "trimmed", "axis": "y"}),
        (calls.goto(12.5), "goto", {"position_um": 12.5}),
        (
            calls.goto(-1, axis="x", speed_um_per_s=5),
            "goto",
            {"position_um": -1.0, "axis": "x", "speed_um_per_s": 5.0},
        ),
        (calls.follow(), "follow", {}),
        (calls.follow(axis="y"), "follow", {"axis": "y"}),
        (calls.hold(), "hold", {}),
        (calls.resume(), "resume", {}),
        (calls.condition(), "condition", {}),
        (calls.zero(axis="x"), "zero", {"axis": "x"}),
        (calls.stop(), "stop", {}),
        (calls.estop(), "estop", {}),
        (calls.reset(engineer=True), "reset", {"engineer": True}),
        (calls.shutdown(), "shutdown", {}),
        (calls.reload(), "reload", {}),
        (calls.save_params(), "params/save", {}),
        (calls.load_params(), "params/load", {}),
        (calls.restore_params(3), "params/restore", {"sequence": 3}),
        (calls.start_recording(), "recordings/start", {}),
        (calls.start_recording("creep"), "recordings/start", {"label": "creep"}),
        (calls.stop_recording(), "recordings/stop", {}),
        (calls.renew_lease(), "lease", {}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_bodies(call: Call[object], path: str, body: object) -> None:
    """The body is the request without its kind, and without what is left out."""
    assert (call.method, call.path, call.body) == ("POST", path, body)


def test_waveform_may_be_written_as_in_a_file() -> None:
    """Mappings and lists are as good as models."""
    points = {"kind": "points", "points": [[0, 0], [1, 5]]}

    call = calls.wave({"x": SINE, "y": points}, 10)

    assert call.body is not None
    assert call.body["duration_s"] == 10
    assert call.body["command_um"]["x"].items() >= SINE.items()
    assert call.body["command_um"]["y"] == {"kind": "points", "points": ((0.0, 0.0), (1.0, 5.0))}


def test_waveform_may_be_a_model() -> None:
    """What a configuration holds can be sent."""
    points = Points(kind="points", points=((0.0, 0.0), (1.0, 5.0)))

    call = calls.identify({"x": points}, 1.0)

    assert call.path == "identify"
    assert call.body == {
        "drive_v": {"x": {"kind": "points", "points": ((0.0, 0.0), (1.0, 5.0))}},
        "duration_s": 1.0,
    }


def test_points_of_a_file_are_sent(tmp_path: Path) -> None:
    """The daemon reads no files of its clients, so the points in them are sent, however deep."""
    (tmp_path / "a.csv").write_text("t_s,x\n0,0\n1,5\n", encoding="utf-8")
    file = {"kind": "csv", "path": str(tmp_path / "a.csv"), "column": "x"}

    call = calls.wave({"x": {"kind": "sum", "parts": [SINE, file]}}, 1.0)

    assert call.body is not None
    parts = call.body["command_um"]["x"]["parts"]
    assert parts[1] == {"kind": "points", "points": ((0.0, 0.0), (1.0, 5.0))}


def test_model_is_sent_whole() -> None:
    """A model goes with everything in it, and without what it does not have."""
    model = load_model(ROOT / "config" / "models" / "simulated-stack.yaml")

    call = calls.adopt(model, axis="x")

    assert call.path == "model"
    assert call.body is not None
    assert call.body.keys() == {"axis", "model"}
    sent = tupled(json.loads(json.dumps(call.body["model"])))
    assert ModelFile.model_validate(sent) == model


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: calls.goto(float("nan")), "position_um: must be a finite number"),
        (lambda: calls.goto(1e9), "position_um: out of range"),
        (lambda: calls.mode("sideways"), "mode: "),
        (lambda: calls.goto(1, axis="X Y"), "axis: not well formed"),
        (lambda: calls.wave({"x": SINE}, -1), "duration_s: out of range"),
        (lambda: calls.wave({"x": {"kind": "csv", "path": "no.csv", "column": "x"}}, 1), "no.csv"),
    ],
)
def test_impossible_values_are_refused_before_they_are_sent(
    make: Callable[[], Call[Answer]], text: str
) -> None:
    """What no daemon can accept needs none to find out."""
    with pytest.raises(RefusedError) as refused:
        make()

    assert text in str(refused.value)
    assert refused.value.code == "value"


def test_both_clients_have_every_call() -> None:
    """The table is the interface, for programs with and without asyncio."""
    names = [
        name
        for name, thing in vars(calls).items()
        if inspect.isfunction(thing) and thing.__module__ == calls.__name__ and name[0] != "_"
    ]

    assert len(names) > 25
    for client in (StageClient, AsyncStageClient):
        assert [name for name in names if not hasattr(client, name)] == []


def test_methods_explain_themselves() -> None:
    """Help and signature of a method are those of the call, with the result that it returns."""
    method = StageClient.goto

    assert inspect.getdoc(method) == inspect.getdoc(calls.goto)
    signature = inspect.signature(method)
    assert list(signature.parameters) == ["self", "position_um", "axis", "speed_um_per_s"]
    assert signature.return_annotation is Answer
