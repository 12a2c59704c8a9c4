import httpx
import pytest

from piezod.messages import requests
from piezod.messages.endpoints import Endpoint, Role
from piezod.messages.requests import TABLE
from tests.daemon.service.bodies import BODIES
from tests.daemon.service.fakes import Served


def test_goto_is_carried_out(served: Served, client: httpx.Client) -> None:
    """A request reaches the stage as a model; the answer has the movement and the state."""
    answer = client.post("goto", json={"position_um": 12.5, "axis": "x"})

    accepted = {"accepted": True, "motion": 7, "duration_s": 0.75, "state": "SAFE"}
    assert answer.json() == accepted
    assert served.stage.requests == [requests.Goto(position_um=12.5, axis="x")]


COMMANDS = [row for row in TABLE.values() if row.request is not None]


@pytest.mark.parametrize("row", COMMANDS, ids=lambda row: row.path)
def test_every_command_reaches_the_stage(served: Served, row: Endpoint) -> None:
    """The path of a row takes its request as the body."""
    with served.client() as client:
        answer = client.post(row.path, json=BODIES.get(row.path, {}))

    assert answer.status_code == 200, answer.text
    assert type(served.stage.requests[0]) is row.request


def test_empty_body_is_an_empty_object(served: Served, client: httpx.Client) -> None:
    """Commands without parameters need no body."""
    client.post("hold")

    assert served.stage.requests == [requests.Hold()]


def test_lists_are_taken_by_strict_models(served: Served, client: httpx.Client) -> None:
    """A waveform of points, lists in JSON, arrives as tuples."""
    points = {"kind": "points", "points": [[0.0, 1.0], [1.0, 2.0]]}
    client.post("wave", json={"command_um": {"x": points}, "duration_s": 1.0}).raise_for_status()

    request = served.stage.requests[0]
    assert isinstance(request, requests.Wave)
    assert request.command_um["x"].model_dump()["points"] == ((0.0, 1.0), (1.0, 2.0))


@pytest.mark.fault("C13")
def test_refusal_has_the_reason_of_the_stage(served: Served, client: httpx.Client) -> None:
    """A request that the state does not allow is answered with 409 and the reason."""
    served.stage.refusal = "the stage is SAFE; arm it first"
    answer = client.post("goto", json={"position_um": 1.0})

    assert answer.status_code == 409
    assert answer.json()["error"]["code"] == "refused"
    assert answer.json()["error"]["what"] == "the stage is SAFE; arm it first"


@pytest.mark.fault("C10")
def test_value_that_the_stage_does_not_allow_is_invalid(
    served: Served, client: httpx.Client
) -> None:
    """A refusal because of a value has the code of a value, not that of the state."""
    served.stage.refusal = "position out of range (got 26.0000001 µm), allowed range 0 to 26 µm"
    answer = client.post("goto", json={"position_um": 26.0000001})

    assert (answer.status_code, answer.json()["error"]["code"]) == (422, "invalid")
    assert answer.json()["error"]["what"] == served.stage.refusal


@pytest.mark.fault("C13")
@pytest.mark.parametrize("state", ["BLIND", "FAULT"])
def test_refusal_of_a_stopped_stage_names_its_faults(
    served: Served, client: httpx.Client, state: str
) -> None:
    """If faults have stopped the stage, their remedies are the remedy."""
    served.stage.refusal = f"cannot reset in {state}"
    served.stage.state = state

    assert client.post("reset").json()["error"]["remedy"] == "S5, stuck: look"


def test_no_loop_is_503(served: Served, client: httpx.Client) -> None:
    """Without a loop the error says so."""
    served.stage.lost_link = True
    answer = client.post("stop")

    assert (answer.status_code, answer.json()["error"]["code"]) == (503, "unavailable")


@pytest.mark.fault("C10")
@pytest.mark.parametrize("position_um", [1e9, "1.0", True, None, [1.0]])
def test_setpoint_that_is_not_allowed_is_refused(
    served: Served, client: httpx.Client, position_um: object
) -> None:
    """A setpoint out of range or of another type is refused, not clamped."""
    answer = client.post("goto", json={"position_um": position_um})

    assert answer.status_code == 422
    assert answer.json()["error"]["what"].startswith("position_um: ")
    assert "100000 µm" in answer.json()["error"]["what"]
    assert served.called() == 0


def test_unknown_key_is_refused(served: Served, client: httpx.Client) -> None:
    """A misspelt key is refused."""
    answer = client.post("goto", json={"position_um": 1.0, "sped": 3})

    assert answer.json()["error"]["what"] == "sped: unknown key"
    assert served.called() == 0


@pytest.mark.parametrize("part", [{"kind": "csv", "path": "/etc/passwd", "column": "x"}])
def test_files_are_not_read_for_clients(
    served: Served, client: httpx.Client, part: dict[str, object]
) -> None:
    """A waveform from a file is refused before validation reads the file."""
    sequence = {"kind": "sequence", "parts": [{"duration_s": 1.0, "waveform": part}]}
    answer = client.post("wave", json={"command_um": {"x": sequence}, "duration_s": 1.0})

    assert answer.status_code == 422
    assert "points" in answer.json()["error"]["remedy"]
    assert served.called() == 0


def test_only_engineers_reset_level_3(served: Served, client: httpx.Client) -> None:
    """An operator cannot end the faults of an engineer."""
    served.roles.role = Role.OPERATOR
    codes = [client.post("reset", json={"engineer": asked}).status_code for asked in (True, False)]

    assert codes == [403, 200]
    assert served.stage.requests == [requests.Reset(engineer=False)]


def test_audit_has_every_command(served: Served, client: httpx.Client) -> None:
    """The audit has user, client, request and the reason of a refusal."""
    client.post("goto", json={"position_um": 1.5})
    served.stage.refusal = "no"
    client.post("arm")

    assert [(e.peer.user, e.peer.client, e.what, e.why) for e in served.stage.audited] == [
        ("somebody", "test", "goto {'position_um': 1.5}", ""),
        ("somebody", "test", "arm", "no"),
    ]
