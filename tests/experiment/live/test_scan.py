"""A scan on a running stage: its request, and its samples as they come."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from piezod.control.stage.drive_requests import scan_table
from piezod.devices.player import Comparison, EdgeWaits
from piezod.devices.scan_table import ScanTable
from piezod.experiment.live.scan import RunningScanStage
from piezod.experiment.live.stage import LiveStage
from piezod.experiment.play.axis import PlayingAxis
from piezod.messages import requests as rq
from piezod.telemetry.requests_codec import decode, encode

POINTS, SWEEPS = 4, 3
EDGES = [[200_000, True], [300_000, False], [1_000_000, True], [9_000_000, True]]


class FakeLiveStage:
    """A stage that answers with two parts of a scan; its samples count up."""

    def __init__(self) -> None:
        self.request: dict[str, Any] = {}
        self.notes = list[str]()

    def scan(self, **request: Any) -> Iterator[dict[str, Any]]:
        """Note the request; yield nothing first, then two sweeps, then one."""
        self.request = request
        for first, sweeps in ((0, 0), (0, 2), (2, 1)):
            rows = range(first * POINTS, (first + sweeps) * POINTS)
            values = [float(row) for row in rows]
            samples = {"x": values, "y": [None, *values][: len(values)], "photons": values}
            yield {
                "axes": ["x", "y"],
                "inputs": ["photons"],
                "first": first,
                "samples": samples,
                "edges": EDGES if request.get("edges") else [],
                "waits_s": 2.0 if request.get("edges") and not sweeps else None,
            }


def table() -> ScanTable:
    """Return a scan of two axes."""
    rng = np.random.default_rng(1)
    return ScanTable(
        axes=("x", "y"),
        interval_ns=50_000,
        lead_in_v=rng.uniform(0.0, 100.0, (7, 2)),
        line_v=rng.uniform(0.0, 100.0, (2 * POINTS, 2)),
        offset_v=rng.uniform(0.0, 100.0, (SWEEPS, 2)),
        scale=rng.uniform(0.9, 1.1, (SWEEPS, 2)),
        blend=np.tile(np.array([0.0, 0.0, 0.5, 1.0])[:, None], (1, 2)),
        pulses=np.array([3, 0, 1, 0], np.uint8),
        framed=4,
        frame_points=1,
        pause=3,
    )


def stage() -> tuple[FakeLiveStage, RunningScanStage]:
    """Return a fake stage, and the axes that scan on it; the zero of x is at 1 µm."""
    fake = FakeLiveStage()
    zeros = {"x": 1.0, "y": 0.0}
    axes = {
        name: SimpleNamespace(stage=SimpleNamespace(zero_um=zero)) for name, zero in zeros.items()
    }
    playing = cast("dict[str, PlayingAxis]", axes)
    return fake, RunningScanStage(cast("LiveStage", fake), playing, fake.notes.append)


def test_samples_come_sweep_by_sweep() -> None:
    """Relative to the zeros, with their time; an invalid one is NaN."""
    _, on = stage()
    first, second, third = on.scan(table())

    assert first.position_um[:, 0].tolist() == [-1.0, 0.0, 1.0, 2.0]
    assert np.isnan(first.position_um[0, 1])
    assert second.detected[:, 0].tolist() == [4.0, 5.0, 6.0, 7.0]
    assert (third.sweep, third.first_ns) == (2, 2 * POINTS * 50_000)


def test_sweeps_between_edges_have_their_time() -> None:
    """Each begins some points behind the edge that ended the one before; the wait is told."""
    fake, on = stage()
    sent = table()._replace(edges=EdgeWaits(3, POINTS, SWEEPS, 2_000_000_000), tail=5)
    found = list(on.scan(sent))
    request = decode(encode(rq.Scan.model_validate(_tupled(fake.request))))
    assert isinstance(request, rq.Scan)
    got = scan_table(request)

    assert len(fake.notes) == 1
    assert [sweep.first_ns for sweep in found] == [0, 250_000, 1_050_000]
    assert [edge.used for edge in on.edges] == [True, False, True, True]
    assert (got.edges, got.tail, got.n_rows) == (sent.edges, 5, SWEEPS * POINTS + 5)
    assert got.rows(10, got.n_rows)[-6:] == pytest.approx(np.tile(got.rows(11, 12), (6, 1)))
    assert got.masks(10, got.n_rows)[2:].tolist() == [0] * 5


def test_the_loop_plays_the_table_of_the_client() -> None:
    """Within 20 µV, through request, mailbox and back; pulses exactly."""
    fake, on = stage()
    sent = table()
    list(on.scan(sent))
    request = decode(encode(rq.Scan.model_validate(_tupled(fake.request))))
    assert isinstance(request, rq.Scan)
    got = scan_table(request)

    assert got.rows(0, sent.n_rows) == pytest.approx(sent.rows(0, sent.n_rows), abs=1e-4)
    assert got.lead_in_v == pytest.approx(sent.lead_in_v, abs=2e-5)
    assert got.masks(0, sent.n_rows).tolist() == sent.masks(0, sent.n_rows).tolist()
    assert (got.axes, got.interval_ns, got.pause) == (sent.axes, sent.interval_ns, sent.pause)


def test_a_device_compares_readings_not_displacements() -> None:
    """The zero of the first sensor is added on the way to the loop."""
    fake, on = stage()
    list(on.scan(table()._replace(compared=Comparison(4, 0, 2.0, 7.0, 0.5))))
    request = decode(encode(rq.Scan.model_validate(_tupled(fake.request))))
    assert isinstance(request, rq.Scan)

    assert scan_table(request).compared == Comparison(4, 0, 3.0, 8.0, 0.5)


def _tupled(value: object) -> object:
    if isinstance(value, dict):
        return {key: _tupled(each) for key, each in value.items()}
    return tuple(map(_tupled, value)) if isinstance(value, list) else value


def test_points_between_sweeps_blend() -> None:
    """A sweep begins with its own offset, and ends with that of the next one, if there is one."""
    plain = table()._replace(line_v=np.zeros((2 * POINTS, 2)), scale=np.ones((SWEEPS, 2)))
    rows = plain.rows(0, plain.n_rows)[:, 0]
    offsets = plain.offset_v[:, 0]

    assert rows[0] == pytest.approx(offsets[0])
    assert rows[2] == pytest.approx(0.5 * (offsets[0] + offsets[1]))
    assert rows[3] == pytest.approx(offsets[1])
    assert rows[-1] == pytest.approx(offsets[2])
    assert plain.rows(3, 9)[:, 0] == pytest.approx(rows[3:9])
    assert plain.masks(0, 12).tolist() == [7, 0, 1, 0, 3, 0, 1, 0, 3, 0, 1, 0]


def test_no_step_exceeds_the_bound_that_the_guard_judges() -> None:
    """The bounds are those of the curves: no point of the table is beyond them."""
    for seed in range(5):
        given = table()
        rng = np.random.default_rng(seed)
        given = given._replace(line_v=rng.uniform(-50.0, 50.0, given.line_v.shape))
        every = np.concatenate((given.lead_in_v, given.rows(0, given.n_rows)))
        low, high = given.bounds_v()

        assert (every >= low - 1e-9).all()
        assert (every <= high + 1e-9).all()
        for place in range(2):
            steps = np.abs(np.diff(every[:, place]))
            assert steps.max() <= given.largest_step_v(place) + 1e-9


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("pulses", (1,) * (POINTS + 1), f"{POINTS} or {2 * POINTS} are needed"),
        ("compared", {"line": 1, "first_um": 5, "last_um": 2, "step_um": 1}, "does not lead"),
    ],
)
def test_wrong_pulses_of_a_request_are_named(field: str, value: object, words: str) -> None:
    """A mask has the points of a sweep, or of the whole line; steps lead from first to last."""
    fake, on = stage()
    list(on.scan(table()._replace(pulses=np.ones(2 * POINTS, np.uint8))))
    request = _tupled(fake.request)
    assert isinstance(request, dict)
    rq.Scan.model_validate(request)

    with pytest.raises(ValueError, match=words):
        rq.Scan.model_validate({**request, field: value})
