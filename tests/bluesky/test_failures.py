"""Plans that are aborted or fail: what becomes of the stages, and what the plan reports."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import pytest
from bluesky import plan_stubs as bps
from bluesky import plans as bp
from bluesky.run_engine import RunEngine
from bluesky.utils import FailedStatus, MsgGenerator, RunEngineInterrupted

from piezod.bluesky import PiezoStage
from piezod.client import arrival
from piezod.errors import ClientError, NotReachedError, NotRunningError, RefusedError
from tests.bluesky.fixtures import make_run
from tests.bluesky.rigs import Bench, Documents
from tests.daemon.waiting import eventually

pytestmark = pytest.mark.bluesky


def state(bench: Bench) -> Any:
    """Return the state of a stage."""
    return bench.daemon.status()["state"]


@contextmanager
def when(condition: Callable[[], object], action: Callable[[], object]) -> Iterator[None]:
    """Carry out an action as soon as a condition is true, while the block runs."""

    def act() -> None:
        eventually(condition, 60.0)
        action()

    thread = threading.Thread(target=act)
    thread.start()
    yield
    thread.join()


def meanwhile(
    bench: Bench, action: Callable[[], object], beyond_um: float = 3.5
) -> AbstractContextManager[None]:
    """Carry out an action when the stage is on a way of some seconds, while the block runs."""

    def on_its_way() -> bool:
        axis = bench.daemon.status()["axes"]["x"]
        way_um = abs((axis["target_um"] or 0.0) - (axis["position_um"] or 0.0))
        return way_um > 5.0 and (axis["position_um"] or 0.0) > beyond_um

    return when(on_its_way, action)


def fails_with(engine: RunEngine, plan: MsgGenerator[Any], kind: type[ClientError]) -> str:
    """Run a plan that a movement lets fail; return the text of its error."""
    with pytest.raises(FailedStatus) as caught:
        engine(plan)
    assert isinstance(caught.value.__cause__, kind)
    return str(caught.value.__cause__)


@pytest.mark.parametrize(("verb", "left_in"), [("stop", "RAMP"), ("hold", "HOLD")])
def test_a_movement_that_somebody_stops_fails_the_plan(
    engine: RunEngine, documents: Documents, x: PiezoStage, coarse: Bench, verb: str, left_in: str
) -> None:
    """The reason names the state; the next plan does not undo what somebody else has done."""
    with meanwhile(coarse, lambda: coarse.daemon.do(verb)):
        text = fails_with(engine, bp.scan([], x.x, 2.0, 22.0, 2), NotReachedError)

    assert f"went to {left_in}" in text
    assert documents.of("stop")[0]["exit_status"] == "fail"
    with pytest.raises(FailedStatus) as caught:
        engine(bp.scan([], x.x, 2.0, 4.0, 2))
    assert isinstance(caught.value.__cause__, RefusedError)
    assert "arm, resume or reset it before the plan" in str(caught.value.__cause__)


def test_an_aborted_plan_leaves_both_stages_held(
    engine: RunEngine,
    documents: Documents,
    x: PiezoStage,
    y: PiezoStage,
    coarse: Bench,
    fine: Bench,
) -> None:
    """Both are in HOLD: the one that moved, and the one that stood; the next plan resumes them."""
    plan = bp.grid_scan([], x.x, 5.0, 9.0, 2, y.x, 2.0, 24.0, 2)
    with meanwhile(fine, lambda: engine.abort("enough")), pytest.raises(RunEngineInterrupted):
        engine(plan)

    assert documents.of("stop")[0]["exit_status"] == "abort"
    assert (state(coarse), state(fine)) == ("HOLD", "HOLD")
    assert coarse.daemon.status()["lease"] is None
    engine(bps.mv(x.x, 6.0, y.x, 6.0))
    assert (state(coarse), state(fine)) == ("RUN", "RUN")


def test_a_plan_with_an_error_leaves_both_stages_held(
    engine: RunEngine, x: PiezoStage, y: PiezoStage, coarse: Bench, fine: Bench
) -> None:
    """An exception of the plan itself holds the stages, although they stand."""

    def plan() -> MsgGenerator[None]:
        yield from bps.mv(x.x, 6.0, y.x, 6.0)
        raise ValueError("no light")

    with pytest.raises(ValueError, match="no light"):
        engine(plan())

    assert (state(coarse), state(fine)) == ("HOLD", "HOLD")


def test_ctrl_c_holds_and_the_plan_can_go_on(
    engine: RunEngine, documents: Documents, x: PiezoStage, coarse: Bench
) -> None:
    """Ctrl-C twice pauses: the stage is held. `RE.resume` finishes the scan."""

    def interrupt() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        here_um = coarse.daemon.status()["axes"]["x"]["position_um"]
        # A second signal within 0.1 s would not count.
        eventually(lambda: coarse.daemon.status()["axes"]["x"]["position_um"] > here_um + 3.0)
        os.kill(os.getpid(), signal.SIGINT)

    engine(bps.mv(x.x, 2.0))
    with meanwhile(coarse, interrupt), pytest.raises(RunEngineInterrupted):
        engine(bp.scan([], x.x, 22.0, 4.0, 2))
    assert state(coarse) == "HOLD"
    engine.resume()

    positions_um = [event["data"]["coarse-x"] for event in documents.of("event")]
    assert positions_um == pytest.approx([22.0, 4.0], abs=0.6)
    assert state(coarse) == "RUN"


def test_a_movement_that_nobody_waits_for_ends_with_the_plan(
    engine: RunEngine, x: PiezoStage, coarse: Bench
) -> None:
    """The stage is held on the way; the next movement resumes it."""

    def plan() -> MsgGenerator[None]:
        yield from bps.mv(x.x, 2.0)
        yield from bps.abs_set(x.x, 22.0)
        while (yield from bps.rd(x.x)) < 4.0:
            pass

    engine(plan())

    assert state(coarse) == "HOLD"
    engine(bps.mv(x.x, 3.0))
    assert coarse.daemon.status()["axes"]["x"]["position_um"] == pytest.approx(3.0, abs=0.6)


def test_a_movement_that_has_not_begun_does_not_begin_after_the_plan(
    engine: RunEngine, x: PiezoStage, coarse: Bench
) -> None:
    """The plan ends at once: the stage stays where it is, or is held before it gets far."""
    engine(bps.mv(x.x, 2.0))
    engine(bps.abs_set(x.x, 22.0))

    engine(bps.sleep(1.0))
    axis = coarse.daemon.status()["axes"]["x"]
    assert axis["position_um"] == pytest.approx(2.0, abs=1.5)
    assert state(coarse) == ("RUN" if axis["target_um"] == 2.0 else "HOLD")


def test_a_movement_that_takes_too_long_fails(
    engine: RunEngine, x: PiezoStage, coarse: Bench
) -> None:
    """After the time-out the plan fails, and the stage is held."""
    engine(bps.mv(x.x, 2.0))

    text = fails_with(engine, bps.abs_set(x.x, 22.0, wait=True, timeout=0.2), NotReachedError)

    assert "coarse-x: 22 µm not reached within 0.2 s" in text
    assert state(coarse) == "HOLD"


@pytest.mark.parametrize(("settle_s", "arrives"), [(1.0, True), (-3.0, False)])
def test_a_movement_gets_the_time_that_it_takes(
    engine: RunEngine,
    x: PiezoStage,
    monkeypatch: pytest.MonkeyPatch,
    settle_s: float,
    arrives: bool,
) -> None:
    """Nearly twice its way at the configured speed, as the daemon says, and some time to settle."""
    engine(bps.mv(x.x, 2.0))
    monkeypatch.setattr(arrival, "ARRIVAL_MARGIN_S", settle_s)

    if arrives:
        engine(bps.mv(x.x, 22.0))
    else:
        text = fails_with(engine, bps.abs_set(x.x, 22.0, wait=True), NotReachedError)
        assert "not on target within" in text


def test_a_stage_of_another_client_is_left_alone(
    engine: RunEngine, x: PiezoStage, coarse: Bench
) -> None:
    """Without the lease the plan fails, and does not hold the stage that another client moves."""
    assert coarse.daemon.ask("POST", "lease", {}).status_code == 200

    text = fails_with(engine, bp.scan([], x.x, 2.0, 4.0, 2), RefusedError)

    assert "holds the lease" in text
    assert state(coarse) == "RUN"


def test_a_killed_daemon_fails_the_plan_and_the_other_stage_is_held(
    engine: RunEngine, x: PiezoStage, y: PiezoStage, coarse: Bench, fine: Bench
) -> None:
    """The reason is that the daemon has ended; after its restart the same device moves again."""
    engine(bps.mv(x.x, 6.0, y.x, 2.0))
    plan = bp.grid_scan([], x.x, 5.0, 9.0, 2, y.x, 2.0, 24.0, 2)
    try:
        with meanwhile(fine, fine.daemon.process.kill):
            text = fails_with(engine, plan, NotRunningError)
        assert "the daemon has ended" in text
        assert state(coarse) == "HOLD"
    finally:
        fine.daemon.process.wait()
        fine.daemon.start()
        eventually(lambda: fine.daemon.status().get("state") in {"SAFE", "FAULT"}, 90.0)
    make_run(fine.daemon)
    engine(bps.mv(y.x, 4.0))
    assert fine.daemon.status()["axes"]["x"]["position_um"] == pytest.approx(4.0, abs=0.6)
