"""Tests of properties of a stage for any requests in any order."""

from itertools import pairwise
from math import inf, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.config import requests as rq
from piezod.config.daemon import DaemonConfig
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms import Sine, Triangle
from piezod.control.stage.stage import DRIVEN
from piezod.control.watch.loop import CycleTiming
from tests.control.rig_stage import ON_TIME, RigStage, shipped_config

REQUESTS: list[rq.Request] = [
    rq.Arm(),
    rq.Arm(shadow=True),
    rq.Disarm(),
    *(rq.SelectMode(mode=mode) for mode in Mode),
    rq.Goto(position_um=0.0),
    rq.Goto(position_um=25.0, speed_um_per_s=1e6),
    rq.Goto(position_um=-1.0),
    rq.Wave(command_um={"x": Sine(kind="sine", low=0, high=25, frequency_hz=50)}, duration_s=1),
    rq.Stream(axes=("x",)),
    rq.Hold(),
    rq.Resume(),
    rq.Stop(),
    rq.Estop(),
    rq.Reset(),
    rq.Condition(),
    rq.Zero(),
    rq.Identify(
        drive_v={"x": Triangle(kind="triangle", low=50, high=150, frequency_hz=5)}, duration_s=0.5
    ),
    rq.Shutdown(),
]
LATE = CycleTiming(900_000, 3, 2_000_000, 0, 0)
GONE = CycleTiming(0, 500, 10_000, 0, 0)

steps = st.tuples(
    st.sampled_from(REQUESTS),
    st.integers(1, 300),
    st.sampled_from([ON_TIME] * 6 + [LATE, GONE]),
    st.floats(0.0, 30.0) | st.sampled_from([nan, inf, -1.0]),
)
UP = {State.RUN, State.IDENT}
UP_FROM = {State.READY, State.HOLD, *UP}


def run_through(
    config: DaemonConfig, sent: list[tuple[rq.Request, int, CycleTiming, float]]
) -> RigStage:
    """Send the requests one after the other, with cycles and setpoints in between."""
    stage = RigStage(config)
    stage.cycle()
    for request, cycles, timing, setpoint_um in sent:
        stage.controller.execute(request, stage.t_ns)
        stage.cycle(timing)
        for _ in range(cycles):
            stage.controller.stream_um(0, setpoint_um, stage.t_ns)
            stage.cycle()
    return stage


@pytest.fixture(scope="module")
def config() -> DaemonConfig:
    """Return the configuration of the repository."""
    return shipped_config()


@settings(max_examples=15, deadline=None)
@given(sent=st.lists(steps, min_size=3, max_size=20))
def test_requests_in_any_order_never_break_a_limit(
    config: DaemonConfig, sent: list[tuple[rq.Request, int, CycleTiming, float]]
) -> None:
    """The amplifier gets voltages in range and within the slew rate, in every cycle."""
    stage = run_through(config, sent)
    limits, writes = config.axes["x"].limits, stage.channels.writes

    assert all(limits.drive_min_v <= drive_v <= limits.drive_max_v for _, (drive_v,) in writes)
    for (before_ns, (before_v,)), (t_ns, (drive_v,)) in pairwise(writes):
        if t_ns - before_ns <= 2 * stage.period_ns:
            assert abs(drive_v - before_v) <= limits.slew_v_per_s * 1e-3 + 1e-9


@settings(max_examples=15, deadline=None)
@given(sent=st.lists(steps, min_size=3, max_size=20))
def test_motion_starts_from_ready_only(
    config: DaemonConfig, sent: list[tuple[rq.Request, int, CycleTiming, float]]
) -> None:
    """RUN and IDENT follow READY, each other or HOLD; a takeover starts at the read-back."""
    stage = run_through(config, sent)
    written = {t_ns for t_ns, _ in stage.channels.writes}

    for before, record in pairwise(stage.records):
        assert record.state not in UP or before.state in UP_FROM
        if record.state in {State.BOOT, State.SAFE, State.FAULT, State.BLIND}:
            assert record.t_ns not in written
        takes_over = before.state not in DRIVEN and record.state in DRIVEN and not record.shadow
        axis = record.axes[0]
        assert not takes_over or axis.drive_v == pytest.approx(axis.read_back_v, abs=0.5)
    for record in stage.records:
        assert not (record.shadow and record.t_ns in written)


@settings(max_examples=15, deadline=None)
@given(sent=st.lists(steps, min_size=1, max_size=12))
def test_shutdown_ends_at_the_safe_voltage_from_everywhere(
    config: DaemonConfig, sent: list[tuple[rq.Request, int, CycleTiming, float]]
) -> None:
    """It ends within the time of the ramp and some margin."""
    stage = run_through(config, sent)
    stage.controller.execute(rq.Shutdown(), stage.t_ns)
    for _ in range(8000):
        if stage.controller.finished:
            break
        stage.cycle()

    assert stage.controller.finished
    assert stage.channels.read_back(stage.t_ns)[0] == pytest.approx(0.0, abs=0.5)
