"""A scan by the loop: its waveforms, its samples, and the whole of it in virtual time."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.config.experiment import load_experiment
from piezod.config.modes import Mode
from piezod.config.scan import AnyScan, LineScan, StackScan
from piezod.devices import registry
from piezod.errors import DataError, RefusedError
from piezod.experiment.live.plan import LARGEST_REQUEST_BYTES
from piezod.experiment.scan.by_loop import (
    HOLD_S,
    Cycles,
    or_by_loop,
    parts_of,
    plan_by_loop,
    sweep_of,
    waveforms_of,
)
from piezod.experiment.scan.learn import FrameReport
from piezod.experiment.scan.plan import ScanPlan
from piezod.experiment.scan.run import ScanSetting, Told
from piezod.experiment.virtual.scan import scan_virtually
from piezod.hysteresis.memory import FloatArray
from piezod.records.scan_file import read_scan
from tests.experiment.scan.test_plan import AXES, raster, span
from tests.experiment.scan.test_run import AXIS, MODEL, TEXT

PERIOD_NS = 1_000_000


def planned(scan: AnyScan) -> ScanPlan:
    """Return the plan of a scan at 1 kHz."""
    return plan_by_loop(scan, AXES, PERIOD_NS)


def line(repeats: int = 80) -> LineScan:
    """Return a line that is swept for 40 s."""
    given = {"fast": span("x"), "repeats": repeats, "lines_per_s": 2.0, "sweeps": "both"}
    return LineScan.model_validate({**given, "mode": Mode.FEEDFORWARD})


SNAKE, FORWARD = (
    raster(pulses={}, lines_per_s=2.0, mode=Mode.TRIMMED, sweeps=sweeps)
    for sweeps in ("snake", "forward")
)
STACK = StackScan.model_validate(
    {"planes": span("x", 200), "plane_s": 0.2, "move_s": 0.1, "mode": Mode.TRIMMED}
)


@pytest.mark.parametrize(
    ("scan", "least_parts"), [(SNAKE, 1), (FORWARD, 1), (line(), 2), (STACK, 2)]
)
def test_waveforms_follow_the_plan(scan: AnyScan, least_parts: int) -> None:
    """Each part fits into a request, begins where the one before ended, and is on the plan."""
    plan = planned(scan)
    parts = list(parts_of(plan))
    ends = [[each.points[-1][1] for each in waveforms_of(plan, part)[0].values()] for part in parts]

    assert [k for part in parts for k in part.sweeps] == list(range(plan.sweeps))
    assert len(parts) >= least_parts
    for number, part in enumerate(parts):
        waveforms, _ = waveforms_of(plan, part)
        bodies = [each.model_dump(mode="json") for each in waveforms.values()]
        assert len(json.dumps(bodies)) < 0.95 * LARGEST_REQUEST_BYTES
        at = np.arange(part.first, part.end)
        t_s = HOLD_S + (at - part.first) * 1e-9 * PERIOD_NS
        got = np.stack([each.built(1.0).sample(t_s) for each in waveforms.values()], axis=1)
        assert got == pytest.approx(plan.positions_um(at), abs=0.01)
        on_pixels = (at % plan.points < plan.active) & (at >= 0)
        assert got[on_pixels] == pytest.approx(plan.positions_um(at)[on_pixels], abs=2e-5)
        if number:
            starts = [each.points[0][1] for each in waveforms.values()]
            assert starts == ends[number - 1]


def cycles_of(t_s: FloatArray, late_ns: FloatArray) -> Cycles:
    """Return cycles of two axes that move at 1 and 2 µm/s; the second is sampled 0.2 ms early."""
    sample_s = np.stack((t_s, t_s - 2e-4), axis=1)
    position_um = sample_s * np.array([1.0, 2.0])
    return Cycles(t_s, sample_s, position_um, np.full(position_um.shape, np.nan), late_ns)


def test_samples_are_those_of_the_instants_of_the_plan() -> None:
    """Also if cycles are late or missing, whose lateness is told."""
    plan = planned(SNAKE)
    part = next(parts_of(plan))
    nominal_s = np.arange(part.end - part.first + 1000) * 1e-3
    first = round(1000 * HOLD_S) - part.first
    late_ns = np.where(np.arange(nominal_s.size) == first + 5, 300_000.0, 0.0)
    kept = np.arange(nominal_s.size) != first + 9
    cycles = cycles_of((nominal_s + 1e-9 * late_ns)[kept], late_ns[kept])
    samples, found_ns = sweep_of(plan, part, cycles, 0)

    expected = HOLD_S + (np.arange(plan.points) - part.first) * 1e-3
    assert samples.position_um[:, 0] == pytest.approx(expected)
    assert samples.position_um[:, 1] == pytest.approx(2.0 * expected)
    assert {int(k): int(found_ns[k]) for k in np.flatnonzero(found_ns)} == {
        5: 300_000,
        9: PERIOD_NS,
    }


@pytest.mark.parametrize(
    ("scan", "words"),
    [
        (raster(pulses={}, lines_per_s=20.5, mode=Mode.TRIMMED), "a pixel lasts 1.951 ms"),
        (
            StackScan.model_validate(
                {"planes": span("x"), "plane_s": 0.001, "move_s": 0.1, "mode": Mode.TRIMMED}
            ),
            "plane_s lasts 1 ms",
        ),
    ],
)
def test_a_pixel_has_two_cycles(scan: AnyScan, words: str) -> None:
    """A faster one is refused with its time and the least one."""
    with pytest.raises(DataError, match=f"{words}, allowed: at least 2 ms"):
        planned(scan)


def test_the_refusal_of_a_running_stage_names_the_way_without_a_player() -> None:
    """Its daemon knows no scans by the loop."""
    with pytest.raises(DataError, match="no device that plays; with `mode:`"), or_by_loop():
        raise RefusedError("no device that plays")


def test_devices_that_do_not_play_are_scanned_by_the_loop(tmp_path: Path) -> None:
    """Each axis has its own device; the file has the lateness of each pixel, which is 0."""
    axes = "".join(AXIS.replace("NAME", name).replace("MODEL", str(MODEL)) for name in ("x", "y"))
    head, rig = TEXT.partition("devices:\n")[2].partition("axes:\n")[0], "  rig:\n"
    text = TEXT.replace(head, head + head.replace(rig, "  other:\n")).replace("AXES", axes)
    before, after = text.split("  y:\n")
    text = (
        before
        + "  y:\n"
        + after.replace("rig", "other", 1).replace("{device: rig", "{device: other")
    )
    text = text.replace("rate_hz: 200", "rate_hz: 500").replace("lines_per_s: 20", "lines_per_s: 2")
    file = tmp_path / "scan.yaml"
    file.write_text(text)
    notes, frames = list[str](), list[FrameReport]()
    told = Told(lambda _: None, frames.append, lambda *_: None, notes.append)
    setting = ScanSetting(tmp_path / "scan.nxs", "text")
    played = load_experiment(file, registry)
    assert played.scan is not None
    with pytest.raises(DataError, match=r"no common clock.*`mode:`"):
        scan_virtually(played, played.scan, setting, told)
    file.write_text(text.replace("  pulses: {pixel: 1, line: 2, frame: 3}", "  mode: trimmed"))
    config = load_experiment(file, registry)
    assert config.scan is not None
    result = scan_virtually(config, config.scan, setting, told)

    assert frames[-1].true.fast_max < 0.3
    assert frames[-1].true.slow_rms < 0.1
    assert notes == ["the loop does not read photons: the picture shows the error"]
    assert np.isfinite(read_scan(result.file).pictures["error_um"]).all()
    with h5py.File(result.file) as stored:
        assert stored["scan/pixels/late_ns"][()].tolist() == [0] * 24 * 12
