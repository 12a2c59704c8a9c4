"""Short soaks, and the judgement of a soak."""

import re
from math import nan
from pathlib import Path

import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.drive_limits import DriveLimit
from piezod.config.faults import Fault
from piezod.config.gate_reasons import GateReason
from piezod.config.model_file import load_model
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.faults.table import mask
from piezod.control.law.model_files import from_model_file
from piezod.daemon.loop.accept import load
from piezod.telemetry.record import AxisRecord, CycleRecord
from piezod.units import NS_PER_S
from tests.control.surface_rig import VARIANTS, model_path
from tests.daemon.daemons import configuration
from tests.forked import run
from tests.soak.observer import Observer, Row
from tests.soak.rig import CheckedRig
from tests.soak.soak import ERROR_RMS_PCT, GROWN_MB, grown

MODEL = from_model_file(load_model(model_path("stops")))


@pytest.mark.parametrize(
    ("model", "hours"),
    [("surface", 1 / 60), *(pytest.param(one, 1.0, marks=pytest.mark.stress) for one in VARIANTS)],
)
def test_stage_keeps_its_limits_and_recovers(tmp_path: Path, model: str, hours: float) -> None:
    """Random commands, faults and restarts break no limit, and every state has its reason.

    Its process is its own: in virtual time the threads of other tests would wait for ever.
    """
    arguments = ("--hours", f"{hours}", "--model", model, "--seed", "7", "--out", str(tmp_path))
    done = run(arguments, module="tests.soak")
    printed = done.stdout
    cycles, writes = (int(number(rf"{what} (\d+)", printed)) for what in ("cycles", "writes"))

    assert done.returncode == 0, printed + done.stderr
    assert "VIOLATION" not in printed
    assert cycles > 15 * 3600 * hours
    assert writes > 0.2 * cycles
    assert number(r"RUN ([\d.]+)%", printed) > 20.0
    assert len((tmp_path / "soak.csv").read_text().splitlines()) >= 60 * hours


def number(pattern: str, text: str) -> float:
    """Return the number that a pattern finds."""
    found = re.search(pattern, text)
    assert found, text
    return float(found[1])


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> DaemonConfig:
    """Return a configuration with a slew rate of 400 V/s."""
    limits = "{drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 400, rest_v: 0}"
    return load(configuration(tmp_path_factory.mktemp("soak"), limits=limits))


@pytest.mark.parametrize(
    ("written_v", "broken"),
    [
        ((0.0, 20.0, 40.0), 0),
        ((0.0, 20.1), 1),
        ((20.0, 40.0, 19.0), 1),
        ((-0.1,), 1),
        ((150.1,), 1),
        ((nan,), 1),
    ],
)
def test_every_write_is_checked(
    config: DaemonConfig, written_v: tuple[float, ...], broken: int
) -> None:
    """A value out of range, a step above the slew rate and a NaN are found, at 20 Hz."""
    rig = CheckedRig(config, seed=1)
    rig.open()
    rig.activate(0)
    for cycle, drive_v in enumerate(written_v):
        rig.write((drive_v,), cycle * 50_000_000)

    assert len(rig.broken) == broken


def record(
    state: State, present: int = 0, t_s: float = 0.0, command_um: float = nan
) -> CycleRecord:
    """Return a record in which only state, faults, instant and command matter."""
    v = um = nan
    shown = Mode.ADAPTIVE, GateReason.OPEN, False, 0, DriveLimit.NONE
    axis = AxisRecord(0, um, command_um, um, v, v, v, v, v, um, *shown)
    return CycleRecord(int(t_s * NS_PER_S), state, False, False, present, 0, (axis,))


@pytest.mark.parametrize(
    ("records", "asked", "found"),
    [
        ([record(State.RUN), record(State.HOLD)], (), "RUN became HOLD without a reason"),
        ([record(State.RUN), record(State.HOLD)], (State.HOLD,), ""),
        ([record(State.READY), record(State.RUN)], (), ""),
        ([record(State.SAFE), record(State.RUN)], (), "SAFE became RUN without a reason"),
        ([record(State.RUN), record(State.RUN, mask([Fault.S9]), 60.0)], (), "S9 in RUN"),
        ([record(State.RUN), record(State.RUN, mask([Fault.D1]), 60.0)], (), ""),
        ([record(State.RUN), record(State.RUN, mask([Fault.D1]), 20.0)], (), ""),
        ([record(State.RUN), record(State.RUN, mask([Fault.L1]), 60.0)], (), ""),
    ],
)
def test_states_and_faults_need_a_reason(
    tmp_path: Path, records: list[CycleRecord], asked: tuple[State, ...], found: str
) -> None:
    """A stop needs a request or a fault, a motion begins from READY, a fault needs a cause.

    The cause here is a disturbance that ends at 0 s.
    """
    observer = Observer(26.0, tmp_path, MODEL)
    observer.disturbed(0)
    observer.take(records[0])
    observer.asked(*asked)
    observer.take(records[1])
    violations = [text for text in observer.violations if "None became" not in text]

    assert len(violations) == bool(found)
    assert found in "".join(violations)


def rows(count: int, **changed: float) -> list[Row]:
    """Return quiet minutes; a given field rises to its value in the last one."""
    quiet = Row(0.0, 200.0, 20, 4, 10, 1.0, 1000, 5.0, 0.1, 0.3, 0.9, 0, 1, 0, 2.5, 0.0)
    return [
        quiet._replace(
            hour=(i + 1) / 60,
            **{
                name: getattr(quiet, name) + (value - getattr(quiet, name)) * i / (count - 1)
                for name, value in changed.items()
            },
        )
        for i in range(count)
    ]


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({}, []),
        ({"rss_mb": 200.0 + GROWN_MB / 2}, []),
        ({"rss_mb": 200.0 + 2 * GROWN_MB}, ["rss_mb grew"]),
        ({"descriptors": 30.0}, ["descriptors grew"]),
        ({"threads": 9.0}, ["threads grew"]),
        ({"error_rms_pct": 2 * ERROR_RMS_PCT}, ["the error is above"]),
        ({"error_rms_pct": nan}, []),
        ({"drift_pct": 5.5}, []),
        ({"drift_pct": 6.5}, ["the learned model is farther"]),
    ],
)
def test_growth_is_found(changed: dict[str, float], says: list[str]) -> None:
    """Memory, descriptors, threads and errors have their bounds; a gap is no error."""
    found = grown(rows(600, **changed))

    assert len(found) == len(says)
    assert all(part in text for part, text in zip(says, found, strict=True))
