"""Tests of the requests that the methods of a client send."""

import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, assert_type, cast

import pytest

from piezod.client import AsyncStageClient, StageClient, calls
from piezod.client.calls import Call
from piezod.client.request_bodies import tupled
from piezod.config.model_file import ModelFile, load_model
from piezod.config.waveforms.paths import Points
from piezod.errors import RefusedError
from piezod.messages.answers import Answer, Status
from piezod.messages.endpoints import ENDPOINTS
from piezod.messages.requests import REQUESTS, TABLE

ROOT = Path(__file__).parents[2]
SINE = {"kind": "sine", "low": 0, "high": 10.0, "frequency_hz": 1.0}
ResultT = TypeVar("ResultT")
Use = Callable[[StageClient], object]


class Unconnected(StageClient):
    """Notes the call that a method makes, and sends nothing."""

    def __init__(self) -> None:
        self.made: list[Call[Any]] = []

    def call(self, call: Call[ResultT]) -> ResultT:
        self.made.append(call)
        return cast("ResultT", None)


def call_of(use: Use) -> Call[Any]:
    """Return the call that a method makes."""
    stage = Unconnected()
    use(stage)
    (made,) = stage.made
    return made


@pytest.mark.parametrize(
    ("use", "path", "body"),
    [
        (lambda stage: stage.arm(), "arm", {"shadow": False, "confirm_output": False}),
        (lambda stage: stage.disarm(), "disarm", {}),
        (lambda stage: stage.mode("adaptive"), "mode", {"mode": "adaptive"}),
        (lambda stage: stage.mode("trimmed", axis="y"), "mode", {"mode": "trimmed", "axis": "y"}),
        (lambda stage: stage.goto(12.5), "goto", {"position_um": 12.5}),
        (
            lambda stage: stage.goto(-1, axis="x", speed_um_per_s=5),
            "goto",
            {"position_um": -1.0, "axis": "x", "speed_um_per_s": 5.0},
        ),
        (lambda stage: stage.follow(), "follow", {}),
        (lambda stage: stage.follow(axis="y"), "follow", {"axis": "y"}),
        (lambda stage: stage.hold(), "hold", {}),
        (lambda stage: stage.resume(), "resume", {}),
        (lambda stage: stage.condition(), "condition", {}),
        (lambda stage: stage.zero(axis="x"), "zero", {"axis": "x"}),
        (lambda stage: stage.stop(), "stop", {}),
        (lambda stage: stage.estop(), "estop", {}),
        (lambda stage: stage.reset(engineer=True), "reset", {"engineer": True}),
        (lambda stage: stage.shutdown(), "shutdown", {}),
        (lambda stage: stage.reload(), "reload", {}),
        (lambda stage: stage.save_params(), "params/save", {}),
        (lambda stage: stage.load_params(), "params/load", {}),
        (lambda stage: stage.restore_params(3), "params/restore", {"sequence": 3}),
        (lambda stage: stage.start_recording(), "recordings/start", {}),
        (lambda stage: stage.start_recording("creep"), "recordings/start", {"label": "creep"}),
        (
            lambda stage: stage.start_recording(line="exposed", before_s=2.0),
            "recordings/start",
            {"edge": {"line": "exposed", "before_s": 2.0, "duration_s": None}},
        ),
        (lambda stage: stage.stop_recording(), "recordings/stop", {}),
        (lambda stage: stage.keep_recording("a"), "recordings/keep", {"name": "a", "kept": True}),
        (lambda stage: stage.renew_lease(), "lease", {}),
    ],
)
def test_bodies(use: Use, path: str, body: object) -> None:
    """The body has the fields of the request that were given, and no kind."""
    call = call_of(use)

    assert (call.method, call.path, call.body) == ("POST", path, body)


def test_waveform_may_be_written_as_in_a_file() -> None:
    """Mappings and lists take the place of models and tuples."""
    points = {"kind": "points", "points": [[0, 0], [1, 5]]}

    call = call_of(lambda stage: stage.wave({"x": SINE, "y": points}, 10))

    assert call.body is not None
    assert call.body["duration_s"] == 10
    assert call.body["command_um"]["x"].items() >= SINE.items()
    assert call.body["command_um"]["y"] == {"kind": "points", "points": ((0.0, 0.0), (1.0, 5.0))}


def test_waveform_may_be_a_model() -> None:
    """A waveform of a configuration can be sent."""
    points = Points(kind="points", points=((0.0, 0.0), (1.0, 5.0)))

    call = call_of(lambda stage: stage.identify({"x": points}, 1.0))

    assert call.path == "identify"
    assert call.body == {
        "drive_v": {"x": {"kind": "points", "points": ((0.0, 0.0), (1.0, 5.0))}},
        "duration_s": 1.0,
    }


def test_points_of_a_file_are_sent(tmp_path: Path) -> None:
    """A waveform of a file is sent as its points, at any depth: the daemon reads no such files."""
    (tmp_path / "a.csv").write_text("t_s,x\n0,0\n1,5\n", encoding="utf-8")
    file = {"kind": "csv", "path": str(tmp_path / "a.csv"), "column": "x"}

    call = call_of(lambda stage: stage.wave({"x": {"kind": "sum", "parts": [SINE, file]}}, 1.0))

    assert call.body is not None
    parts = call.body["command_um"]["x"]["parts"]
    assert parts[1] == {"kind": "points", "points": ((0.0, 0.0), (1.0, 5.0))}


def test_model_is_sent_whole() -> None:
    """A model is sent with all its fields, except those that are None."""
    model = load_model(ROOT / "config" / "models" / "simulated-stack.yaml")

    call = call_of(lambda stage: stage.adopt(model, axis="x"))

    assert call.path == "model"
    assert call.body is not None
    assert call.body.keys() == {"axis", "model"}
    sent = tupled(json.loads(json.dumps(call.body["model"])))
    assert ModelFile.model_validate(sent) == model


@pytest.mark.parametrize(
    ("use", "text"),
    [
        (lambda stage: stage.goto(float("nan")), "position_um: must be a finite number"),
        (lambda stage: stage.goto(1e9), "position_um: out of range"),
        (lambda stage: stage.mode("sideways"), "mode: "),
        (lambda stage: stage.goto(1, axis="X Y"), "axis: not well formed"),
        (lambda stage: stage.wave({"x": SINE}, -1), "duration_s: out of range"),
        (
            lambda stage: stage.wave({"x": {"kind": "csv", "path": "no.csv", "column": "x"}}, 1),
            "no.csv",
        ),
    ],
)
def test_impossible_values_are_refused_before_they_are_sent(use: Use, text: str) -> None:
    """The client itself refuses a value that no daemon accepts."""
    with pytest.raises(RefusedError) as refused:
        call_of(use)

    assert text in str(refused.value)
    assert refused.value.code == "value"


@pytest.mark.parametrize("client", [StageClient, AsyncStageClient])
def test_both_clients_have_every_command(client: type[StageClient | AsyncStageClient]) -> None:
    """Each row of the table of commands is a method of both clients."""
    assert [name for name in TABLE if not hasattr(client, name)] == ["openapi"]


@pytest.mark.parametrize("name", REQUESTS)
def test_parameters_are_the_fields_of_the_request(name: str) -> None:
    """The method of a request has a parameter for each field; only `mode` calls it `name`."""
    parameters = set(inspect.signature(getattr(StageClient, name)).parameters) - {"self"}
    renamed = {"name": "mode"} if name == "mode" else {}
    fields = set(REQUESTS[name].model_fields) - {"kind"}

    assert {renamed.get(each, each) for each in parameters} == fields


def test_unknown_request_is_a_mistake_of_the_caller() -> None:
    """Endpoints without a request class have calls of their own."""
    assert "status" in ENDPOINTS
    with pytest.raises(KeyError):
        calls.command("status")


@pytest.mark.parametrize("client", [StageClient, AsyncStageClient])
def test_methods_explain_themselves(client: type[StageClient | AsyncStageClient]) -> None:
    """Help shows parameters, docstring and result of a method."""
    method = client.goto
    signature = inspect.signature(method)

    assert method.__name__ == "goto"
    assert (inspect.getdoc(method) or "").startswith("Start a movement to a position")
    assert list(signature.parameters) == ["self", "position_um", "axis", "speed_um_per_s"]
    assert signature.return_annotation is Answer
    assert inspect.iscoroutinefunction(method) == (client is AsyncStageClient)


async def typed(stage: StageClient, other: AsyncStageClient) -> None:
    """Type checkers know the result of each method in both clients; never run."""
    assert_type(stage.goto_and_wait(12.5).position_um, float)
    assert_type(stage.goto(12.5, axis="x"), Answer)
    assert_type(stage.status(), Status)
    assert_type(await other.goto(12.5, axis="x"), Answer)
    assert_type(await other.status(), Status)
    stage.goto("12.5")  # type: ignore[arg-type]
    stage.goto(12.5, speed=1.0)  # type: ignore[call-arg]
    await other.zero(axis=1)  # type: ignore[arg-type]
