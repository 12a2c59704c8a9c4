"""The description of the interface: it must allow what the daemon allows, and no more."""

from dataclasses import is_dataclass
from typing import Any

import httpx
import pytest

from piezod.messages.requests import TABLE
from tests.daemon.service.fakes import Served


@pytest.fixture
def document(client: httpx.Client) -> dict[str, Any]:
    """Return the description."""
    found: dict[str, Any] = client.get("openapi").json()
    return found


def _operation(document: dict[str, Any], what: str) -> dict[str, Any]:
    method, path = what.split()
    found: dict[str, Any] = document["paths"][f"/v1/{path}"][method.lower()]
    return found


def test_health_has_its_document_with_either_status(
    served: Served, client: httpx.Client, document: dict[str, Any]
) -> None:
    """A loop that does not run on schedule is described, not an error document."""
    served.stage.healthy = False
    answer = client.get("health")
    declared = _operation(document, "GET health")["responses"]
    schema = document["components"]["schemas"]["Health"]

    assert declared["200"]["content"] == declared["503"]["content"]
    assert answer.status_code == 503
    assert set(schema["required"]) <= answer.json().keys()


@pytest.mark.parametrize(
    ("what", "media_type"),
    [
        ("GET telemetry", "text/event-stream"),
        ("GET recordings/{name}", "application/x-hdf5"),
        ("GET status", "application/json"),
    ],
)
def test_media_type_is_that_of_the_answer(
    document: dict[str, Any], what: str, media_type: str
) -> None:
    """Errors are JSON in every case."""
    responses = _operation(document, what)["responses"]

    assert list(responses["200"]["content"]) == [media_type]
    assert list(responses["default"]["content"]) == ["application/json"]


@pytest.mark.parametrize(
    ("what", "required"),
    [("POST arm", False), ("POST stop", False), ("POST goto", True), ("POST stream", False)],
)
def test_body_is_required_if_it_has_required_keys(
    document: dict[str, Any], what: str, required: bool
) -> None:
    """An empty body means an empty object."""
    assert _operation(document, what)["requestBody"]["required"] is required


def test_waveforms_from_files_are_not_described(document: dict[str, Any]) -> None:
    """The daemon reads no files of clients."""
    wave = document["components"]["schemas"]["Wave"]["properties"]["command_um"]
    kinds = next(iter(wave["patternProperties"].values()))

    assert "csv" not in kinds["discriminator"]["mapping"]
    assert "Csv" not in str(document)
    assert len(kinds["oneOf"]) == len(kinds["discriminator"]["mapping"]) > 5


def test_names_of_axes_are_the_only_keys(document: dict[str, Any]) -> None:
    """A key that is no name of an axis is refused, also by the description."""
    schemas = document["components"]["schemas"]
    waveforms = [schemas["Wave"]["properties"]["command_um"]]
    waveforms.append(schemas["Identify"]["properties"]["drive_v"])

    assert [each["additionalProperties"] for each in waveforms] == [False, False]


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("PUT", "status", "GET"),
        ("PATCH", "lease", "DELETE, POST"),
        ("HEAD", "recordings/20261121T120000Z", "GET"),
        ("OPTIONS", "goto", "POST"),
        ("PUT", "recordings/start", "POST"),
    ],
)
def test_other_methods_are_refused_with_the_allowed_ones(
    client: httpx.Client, method: str, path: str, allowed: str
) -> None:
    """The header Allow has all methods of the path."""
    answer = client.request(method, path)

    assert (answer.status_code, answer.headers["allow"]) == (405, allowed)


def test_every_answer_is_described(document: dict[str, Any]) -> None:
    """Each answer with a class has its schema, and each field of it the words of the class."""
    for row in TABLE.values():
        if not is_dataclass(row.answer_class) or row.name == "telemetry":
            continue
        described = _operation(document, f"{row.method} {row.path}")["responses"]["200"]
        name = described["content"]["application/json"]["schema"]["$ref"].rpartition("/")[2]
        properties = document["components"]["schemas"][name]["properties"]

        assert name == row.answer
        assert all(each["description"] for each in properties.values()), name
