import json
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray

from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.daemon.service.connection import ConnectionLimits
from piezod.messages.documents import Document
from piezod.telemetry.arrays import record_dtype
from tests.daemon.service.conftest import Serve
from tests.daemon.service.fakes import NAN, Served
from tests.daemon.waiting import eventually


def records_of(positions_um: list[float]) -> NDArray[Any]:
    """Return records of a stage whose axis x is at these positions, at the command 10 µm."""
    records = np.zeros(len(positions_um), record_dtype(2))
    records["t_ns"] = np.arange(len(positions_um)) * 1_000_000 + 2_000_000_000
    records["state"] = list(State).index(State.RUN)
    records["skipped"] = 4
    axis = records["axes"][:, 0]
    axis["position_um"], axis["command_um"], axis["drive_v"] = positions_um, 10.0, 42.0
    axis["mode"], axis["on_target"], axis["motion"] = list(Mode).index(Mode.ADAPTIVE), True, 9
    return records


def _events(answer: httpx.Response) -> Iterator[Document]:
    for line in answer.iter_lines():
        if line.startswith("data: "):
            yield json.loads(line.removeprefix("data: "))


def _first(client: httpx.Client, query: str = "") -> Document:
    with client.stream("GET", f"telemetry?rate_hz=50{query}") as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        return next(_events(answer))


def test_no_spike_is_lost(served: Served, client: httpx.Client) -> None:
    """An interval has the minimum, the maximum and the last value of all its cycles."""
    served.stage.reader.waiting = [records_of([9.0, 13.0, 5.0, 10.0, 10.0])]
    event = _first(client)

    axis = event["axes"]["x"]
    assert axis["position_um"] == {"min": 5.0, "max": 13.0, "last": 10.0}
    assert axis["error_um"] == {"min": -3.0, "max": 5.0, "last": 0.0}
    assert axis["command_um"] == {"min": 10.0, "max": 10.0, "last": 10.0}
    assert axis["drive_v"] == {"min": 42.0, "max": 42.0, "last": 42.0}
    assert (axis["mode"], axis["on_target"], axis["motion"]) == ("adaptive", True, 9)


def test_voltage_is_unknown_in_blind(served: Served, client: httpx.Client) -> None:
    """In BLIND the voltage is that of the read-back, which may be missing, not the last written."""
    records = records_of([1.0, 2.0, 3.0])
    records["axes"]["read_back_v"] = [[NAN], [40.0], [NAN]]
    records["state"][1:] = list(State).index(State.BLIND)
    served.stage.reader.waiting = [records]

    assert _first(client)["axes"]["x"]["drive_v"] == {"min": 40.0, "max": 42.0, "last": None}


def test_interval_has_state_and_counts(served: Served, client: httpx.Client) -> None:
    """Each event has the state and the counts of cycles, lost records and skipped cycles."""
    served.stage.reader.waiting = [records_of([1.0, 2.0])]
    served.stage.reader.lost = 3
    event = _first(client)

    assert {key: event[key] for key in ("t_s", "cycles", "lost", "state", "skipped_cycles")} == {
        "t_s": 2.001,
        "cycles": 2,
        "lost": 3,
        "state": "RUN",
        "skipped_cycles": 4,
    }


def test_interval_has_a_fault_of_one_cycle(served: Served, client: httpx.Client) -> None:
    """An interval has faults that were present only briefly, and faults that are latched."""
    records = records_of([1.0, 2.0, 3.0])
    records["present_lo"][1] = 1 << 5
    records["present_hi"][0] = 1 << 3
    records["latched_lo"] = [1 << 7, 1 << 7, 1 << 8]
    served.stage.reader.waiting = [records]

    assert _first(client)["faults"] == ["F5", "F8", "F67"]


def test_missing_samples_are_left_out(served: Served, client: httpx.Client) -> None:
    """NaN does not count for a range; a range without numbers is null."""
    served.stage.reader.waiting = [records_of([NAN, 3.0, NAN])]
    event = _first(client)

    assert event["axes"]["x"]["position_um"] == {"min": 3.0, "max": 3.0, "last": None}


def test_axes_can_be_chosen(served: Served, client: httpx.Client) -> None:
    """Without a choice an event has all axes; an unknown axis is an error."""
    served.stage.reader.else_ = records_of([1.0])
    every, one = _first(client), _first(client, "&axes=y")

    assert list(every["axes"]) == ["x", "y"]
    assert list(one["axes"]) == ["y"]
    assert client.get("telemetry?axes=z").json()["error"]["remedy"] == "axes: x, y"


@pytest.mark.parametrize("rate", ["0", "51", "nan", "fast"])
def test_rate_is_bounded(client: httpx.Client, rate: str) -> None:
    """The rate is 1 to 50 events per second."""
    answer = client.get(f"telemetry?rate_hz={rate}")

    assert answer.status_code == 422
    assert answer.json()["error"]["what"].startswith("rate_hz: ")


def test_nothing_new_is_a_comment(client: httpx.Client) -> None:
    """Without new records a comment line shows that the connection works."""
    with client.stream("GET", "telemetry?rate_hz=50") as answer:
        assert next(answer.iter_lines()) == ": nothing new"


def test_stream_ends_with_the_server(serve: Serve) -> None:
    """The end of the server ends the event stream properly."""
    served = serve(ConnectionLimits())
    with served.client() as client, client.stream("GET", "telemetry?rate_hz=50") as answer:
        lines = answer.iter_lines()
        next(lines)
        served.server.should_exit = True

        assert set(lines) <= {"", ": nothing new"}


@pytest.mark.fault("C3")
def test_listener_that_leaves_is_forgotten(served: Served, client: httpx.Client) -> None:
    """After a disconnect no further records are read."""
    with client.stream("GET", "telemetry?rate_hz=50") as answer:
        next(answer.iter_lines())
    tasks = served.server.server_state.tasks

    assert eventually(lambda: not tasks)
