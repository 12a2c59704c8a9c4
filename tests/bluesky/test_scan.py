"""Scans of simulated stages, with documents that are compared with the truth of their rigs."""

import time
from typing import Any

import pytest
from bluesky import plans as bp
from bluesky.run_engine import RunEngine

from piezod.bluesky import PiezoStage
from tests.bluesky.rigs import CLOSE_UM, Bench, Documents

pytestmark = pytest.mark.bluesky


def monotonic_s(timestamp: float) -> float:
    """Return an instant of the time of day on the monotonic clock, in s."""
    return timestamp - time.time() + time.monotonic()


def check_event(event: dict[str, Any], key: str, bench: Bench) -> None:
    """Assert that the rig was where the event says."""
    true_um = bench.true_um(monotonic_s(event["timestamps"][key]))
    data = event["data"]
    assert data[key] == pytest.approx(true_um, abs=CLOSE_UM)
    assert data[f"{key}-error"] == pytest.approx(data[f"{key}-command"] - data[key])
    assert 0.0 < data[f"{key}-drive"] < 150.0


def test_a_scan_stops_at_its_points(
    engine: RunEngine, documents: Documents, x: PiezoStage, coarse: Bench
) -> None:
    """Each event has the position at which the stage truly was; the descriptor says what it is."""
    engine(bp.scan([], x.x, 4.0, 16.0, 4))

    events = documents.of("event")
    assert [event["data"]["coarse-x"] for event in events] == pytest.approx(
        [4.0, 8.0, 12.0, 16.0], abs=CLOSE_UM
    )
    for event in events:
        check_event(event, "coarse-x", coarse)
    (descriptor,) = documents.of("descriptor")
    key = descriptor["data_keys"]["coarse-x"]
    assert key["source"] == "piezod://coarse/x/position_um"
    assert (key["units"], key["precision"], key["dtype"]) == ("um", 4, "number")
    assert key["limits"]["control"] == {"low": 0.0, "high": 26.0}
    assert descriptor["data_keys"]["coarse-x-drive"]["units"] == "V"
    assert descriptor["hints"]["coarse-x"] == {"fields": ["coarse-x"]}
    assert descriptor["configuration"]["coarse-x"]["data"]["coarse-x-mode"] == "trimmed"
    assert documents.of("stop")[0]["exit_status"] == "success"
    assert coarse.daemon.status()["state"] == "RUN"


def test_a_grid_scan_moves_two_stages(
    engine: RunEngine,
    documents: Documents,
    x: PiezoStage,
    y: PiezoStage,
    coarse: Bench,
    fine: Bench,
) -> None:
    """All points of the grid are visited, and both rigs were there."""
    engine(bp.grid_scan([], x.x, 5.0, 9.0, 2, y.x, 3.0, 7.0, 3, snake_axes=True))

    events = documents.of("event")
    asked = [(5.0, 3.0), (5.0, 5.0), (5.0, 7.0), (9.0, 7.0), (9.0, 5.0), (9.0, 3.0)]
    for event, (coarse_um, fine_um) in zip(events, asked, strict=True):
        assert event["data"]["coarse-x"] == pytest.approx(coarse_um, abs=CLOSE_UM)
        assert event["data"]["fine-x"] == pytest.approx(fine_um, abs=CLOSE_UM)
        check_event(event, "coarse-x", coarse)
        check_event(event, "fine-x", fine)
