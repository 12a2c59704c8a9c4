"""A scan as a fly scan: its pixels are the rows."""

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bluesky.run_engine import RunEngine
from bluesky.utils import FailedStatus
from ophyd_async.core import StaticPathProvider, UUIDFilenameProvider, init_devices
from scanspec.specs import Concat, Fly, Linspace, Spec, Zip

from piezod.bluesky import PiezoStage, Scan
from piezod.errors import RefusedError
from tests.bluesky.rigs import Documents
from tests.bluesky.test_failures import when
from tests.bluesky.test_fly import column, fly
from tests.daemon.daemons import Daemon, configuration

pytestmark = pytest.mark.bluesky

SLOW: Spec[str] = Linspace("y", 6.0, 9.0, 4)
FAST: Spec[str] = Linspace("x", 6.0, 15.0, 4)
LINE = Scan(
    {
        "kind": "line",
        "fast": {"axis": "x", "from_um": 4.5, "to_um": 16.5, "pixels": 4},
        "repeats": 3,
        "lines_per_s": 1.0,
        "mode": "feedforward",
    }
)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Daemon]:
    """Return the daemon of a simulated stage."""
    with Daemon(configuration(tmp_path)) as daemon:
        yield daemon.up()


@pytest.fixture
def stage(engine: RunEngine, bench: Daemon, tmp_path: Path) -> Iterator[PiezoStage]:
    """Return a stage that a plan arms."""
    with init_devices():
        stage = PiezoStage(
            axes=("x",),
            socket=bench.paths.api_socket,
            path_provider=StaticPathProvider(UUIDFilenameProvider(), tmp_path),
            arm=True,
        )
    yield stage
    asyncio.run_coroutine_threadsafe(stage.disconnect(), engine.loop).result(20.0)


def test_a_scan_has_its_pixels(
    engine: RunEngine, documents: Documents, stage: PiezoStage, bench: Daemon
) -> None:
    """The plan keeps the lease, and the stage is disarmed at the end."""
    engine(fly(stage, LINE))

    rows, columns, position_um = (
        column(documents, f"stage-{name}") for name in ("row", "column", "x")
    )
    assert rows.tolist() == [0] * 4 + [1] * 4 + [2] * 4
    assert columns.tolist() == [0, 1, 2, 3, 3, 2, 1, 0, 0, 1, 2, 3]
    assert position_um == pytest.approx(6.0 + 3.0 * columns, abs=1.5)
    assert np.all(np.diff(column(documents, "stage-t")) > 0)
    assert len(column(documents, "stage-error")) == 12
    assert bench.status()["state"] == "SAFE"


def test_a_scan_that_is_stopped_fails(engine: RunEngine, stage: PiezoStage, bench: Daemon) -> None:
    """With the state in which the stage was left."""
    long = Scan({**LINE.scan, "repeats": 1000})
    moves, stop = (lambda: bench.status()["state"] == "RUN"), (lambda: bench.do("stop"))
    with pytest.raises(FailedStatus) as caught, when(moves, stop):
        engine(fly(stage, long))

    assert "the scan failed" in str(caught.value.__cause__)
    bench.until("SAFE")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fast": {**LINE.scan["fast"], "to_um": 30.0}}, "axis x: 30 um, allowed range 0 to 26"),
        ({"fast": {**LINE.scan["fast"], "axis": "z"}}, "no axis z; axes: x"),
        ({"lines_per_s": -1.0}, "not a scan"),
    ],
)
def test_what_does_not_fit_is_refused_in_prepare(
    engine: RunEngine, stage: PiezoStage, change: dict[str, Any], words: str
) -> None:
    """Nothing moves."""
    with pytest.raises(FailedStatus) as caught:
        engine(fly(stage, Scan({**LINE.scan, **change})))

    assert words in str(caught.value.__cause__)


def test_a_spec_becomes_a_scan() -> None:
    """Its points are the centres of pixels, and its duration is that of a pixel."""
    raster = Scan.of(Fly(0.01 @ (SLOW * ~FAST)), mode="trimmed").scan
    line = Scan.of(FAST, lines_per_s=2.0).scan

    assert raster == {
        "kind": "raster",
        "fast": {"axis": "x", "from_um": 4.5, "to_um": 16.5, "pixels": 4},
        "slow": {"axis": "y", "from_um": 5.5, "to_um": 9.5, "pixels": 4},
        "sweeps": "snake",
        "lines_per_s": pytest.approx(0.8 / 0.04),
        "mode": "trimmed",
    }
    assert (line["kind"], line["sweeps"], line["repeats"]) == ("line", "forward", 1)


@pytest.mark.parametrize(
    "spec",
    [
        Linspace("z", 0.0, 1.0, 2) * SLOW * FAST,
        Zip(FAST, Linspace("y", 6.0, 9.0, 4)),
        Concat(FAST, Linspace("x", 16.0, 20.0, 3)),
        SLOW * Linspace("x", 6.0, 6.0, 1),
    ],
)
def test_other_specs_are_refused(spec: Spec[str]) -> None:
    """Three dimensions, a diagonal, uneven steps, and a single point."""
    with pytest.raises(RefusedError, match="no scan of piezod"):
        Scan.of(spec, lines_per_s=2.0)
