"""Waves as fly scans, whose rows are compared with the truth of the rig."""

from typing import Any
from urllib.parse import urlparse

import h5py
import numpy as np
import pytest
from bluesky import plan_stubs as bps
from bluesky import preprocessors as bpp
from bluesky.consolidators import HDF5Consolidator
from bluesky.run_engine import RunEngine
from bluesky.utils import FailedStatus, MsgGenerator

from piezod.bluesky import PiezoStage, Wave
from piezod.bluesky.flyer import Flight
from piezod.errors import NotReachedError, RefusedError
from tests.bluesky.rigs import CLOSE_UM, Bench, Documents
from tests.bluesky.test_failures import state, when

pytestmark = pytest.mark.bluesky

TRIANGLE = {"kind": "triangle", "low": 4.0, "high": 12.0, "frequency_hz": 0.5}


def fly(stage: PiezoStage, *flights: Flight) -> MsgGenerator[None]:
    """Fly, each time with a file of its own."""

    @bpp.stage_decorator([stage])
    @bpp.run_decorator()
    def inner() -> MsgGenerator[None]:
        for number, flight in enumerate(flights):
            yield from bps.prepare(stage.flyer, flight, wait=True)
            if not number:
                yield from bps.declare_stream(stage.flyer, name="primary", collect=True)
            yield from bps.kickoff(stage.flyer, wait=True)
            yield from bps.complete(stage.flyer, wait=True)
            yield from bps.collect(stage.flyer, name="primary")

    yield from inner()


def column(documents: Documents, key: str) -> Any:
    """Return the rows of a column, read as tiled reads them."""
    (descriptor,) = documents.of("descriptor")
    consolidator = None
    for resource in documents.of("stream_resource"):
        if resource["data_key"] != key:
            continue
        if consolidator is None:
            consolidator = HDF5Consolidator(resource, descriptor)
        else:
            consolidator.update_from_stream_resource(resource)
        for datum in documents.of("stream_datum"):
            if datum["stream_resource"] == resource["uid"]:
                consolidator.consume_stream_datum(datum)
    assert consolidator is not None
    if len(consolidator.assets) == 1:  # it expects that the chunks of several files are joined
        consolidator.validate()
    return consolidator.get_adapter().read()


def test_a_fly_scan_has_every_cycle(
    engine: RunEngine, documents: Documents, x: PiezoStage, coarse: Bench
) -> None:
    """The rows are where the rig truly was, and the wave is in them."""
    engine(fly(x, Wave({"x": TRIANGLE}, duration_s=4.0)))

    position_um, command_um, t_s = (
        column(documents, f"coarse-{name}") for name in ("x", "x-command", "t")
    )
    (file,) = {resource["uri"] for resource in documents.of("stream_resource")}
    with h5py.File(urlparse(file).path) as opened:
        start_s = opened["recording"].attrs["start_ns"] / 1e9
    true_um = np.interp(t_s + start_s, *coarse.truths())
    measured = np.isfinite(position_um)
    assert measured.sum() > 0.9 * position_um.size
    assert np.abs(position_um - true_um)[measured].max() < CLOSE_UM
    assert t_s[-1] - t_s[0] > 4.0
    assert command_um.min() == pytest.approx(4.0, abs=0.1)
    assert command_um.max() == pytest.approx(12.0, abs=1.0)  # the corner is between two cycles
    assert 0.0 < np.nanmin(column(documents, "coarse-x-drive")) < 150.0
    assert documents.of("stop")[0]["num_events"] == {"primary": position_um.size}
    assert coarse.daemon.status()["lease"] is None


def test_several_waves_of_a_plan_have_a_file_each(
    engine: RunEngine, documents: Documents, x: PiezoStage
) -> None:
    """Their rows follow one another in the same stream."""
    short = {**TRIANGLE, "frequency_hz": 2.0}
    engine(fly(x, *[Wave({"x": short}, duration_s=0.5)] * 2))

    data = [datum["seq_nums"] for datum in documents.of("stream_datum")]
    assert len({resource["uri"] for resource in documents.of("stream_resource")}) == 2
    assert data[0]["start"] == 1
    assert data[-1]["start"] == data[0]["stop"]
    assert column(documents, "coarse-x").size == data[-1]["stop"] - 1


def test_a_wave_out_of_range_moves_nothing(engine: RunEngine, x: PiezoStage, coarse: Bench) -> None:
    """It is refused before the stage moves to its start."""
    motion = coarse.daemon.status()["axes"]["x"]["motion"]
    with pytest.raises(FailedStatus) as caught:
        engine(fly(x, Wave({"x": {**TRIANGLE, "high": 40.0}}, duration_s=1.0)))

    assert isinstance(caught.value.__cause__, RefusedError)
    assert "axis x: 4 to 40 µm; allowed: 0 to 26 µm" in str(caught.value.__cause__)
    assert coarse.daemon.status()["axes"]["x"]["motion"] == motion


def test_a_wave_that_somebody_holds_fails_the_plan(
    engine: RunEngine, documents: Documents, x: PiezoStage, coarse: Bench
) -> None:
    """The recording is ended as well."""

    def flies() -> object:
        moves = coarse.daemon.status()["axes"]["x"]["command_um"] > 5.0
        return moves and coarse.daemon.ask("GET", "recordings").json()["running"]

    engine(bps.mv(x.x, 4.0))
    with when(flies, lambda: coarse.daemon.do("hold")), pytest.raises(FailedStatus) as caught:
        engine(fly(x, Wave({"x": TRIANGLE}, duration_s=20.0)))

    assert isinstance(caught.value.__cause__, NotReachedError)
    assert documents.of("stop")[0]["exit_status"] == "fail"
    assert coarse.daemon.ask("GET", "recordings").json()["running"] is None


def test_an_error_of_the_plan_ends_the_wave(
    engine: RunEngine, x: PiezoStage, coarse: Bench
) -> None:
    """Without any preprocessor: to unstage holds the stage and ends the recording."""
    engine.preprocessors.clear()

    @bpp.stage_decorator([x])
    @bpp.run_decorator()
    def plan() -> MsgGenerator[None]:
        yield from bps.prepare(x.flyer, Wave({"x": TRIANGLE}, duration_s=60.0), wait=True)
        yield from bps.kickoff(x.flyer, wait=True)
        raise ValueError("no light")

    with pytest.raises(ValueError, match="no light"):
        engine(plan())

    assert state(coarse) == "HOLD"
    assert coarse.daemon.ask("GET", "recordings").json()["running"] is None


def test_no_place_for_recordings(engine: RunEngine, coarse: Bench) -> None:
    """A stage without a path provider refuses to fly."""
    stage = PiezoStage(axes=("x",), socket=coarse.daemon.paths.api_socket, name="plain")

    with pytest.raises(FailedStatus) as caught:
        engine(bps.prepare(stage.flyer, Wave({"x": TRIANGLE}, duration_s=1.0), wait=True))

    assert "give the stage a path_provider" in str(caught.value.__cause__)
