"""Two stages as devices, and a RunEngine."""

import asyncio
from collections.abc import Iterator
from typing import Any, Final

import pytest
from bluesky.run_engine import RunEngine
from ophyd_async.core import StaticPathProvider, UUIDFilenameProvider, init_devices

from piezod.bluesky import PiezoStage, hold_after_failure
from piezod.config.faults import Fault
from piezod.config.states import State
from tests.bluesky.rigs import Bench, Documents, bench
from tests.daemon.daemons import Daemon
from tests.daemon.waiting import eventually

NEXT: Final[dict[str, tuple[str, dict[str, Any]]]] = {
    State.SAFE: ("arm", {}),
    State.READY: ("condition", {}),
    State.HOLD: ("stop", {}),
    State.FAULT: ("reset", {}),
}
"""How to leave a state for RUN."""


@pytest.fixture(scope="package")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """Return a stage with the axis x."""
    with bench(tmp_path_factory.mktemp("coarse"), "coarse") as found:
        yield found


@pytest.fixture(scope="package")
def fine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """Return another stage with the axis x."""
    with bench(tmp_path_factory.mktemp("fine"), "fine") as found:
        yield found


@pytest.fixture
def engine() -> Iterator[RunEngine]:
    """Return a RunEngine in whose failing plans all stages are held."""
    engine = RunEngine({}, call_returns_result=True)
    engine.preprocessors.append(hold_after_failure)
    yield engine
    if engine.state == "paused":  # the test has failed
        engine.halt()
    engine.loop.call_soon_threadsafe(engine.loop.stop)
    engine._th.join()  # noqa: SLF001 - there is no public way to end it
    engine.loop.close()


@pytest.fixture
def documents(engine: RunEngine) -> Documents:
    """Return the documents that the engine emits."""
    documents = Documents()
    engine.subscribe(documents)
    return documents


@pytest.fixture
def x(engine: RunEngine, coarse: Bench) -> Iterator[PiezoStage]:
    """Return the coarse stage as a device."""
    yield from device(engine, coarse, "coarse")


@pytest.fixture
def y(engine: RunEngine, fine: Bench) -> Iterator[PiezoStage]:
    """Return the fine stage as a device."""
    yield from device(engine, fine, "fine")


def device(engine: RunEngine, bench: Bench, name: str) -> Iterator[PiezoStage]:
    """Yield a stage that runs in mode trimmed; disconnect it afterwards."""
    make_run(bench.daemon)
    with init_devices():
        stage = PiezoStage(
            axes=("x",),
            socket=bench.daemon.paths.api_socket,
            path_provider=StaticPathProvider(UUIDFilenameProvider(), bench.truth.parent),
            name=name,
        )
    yield stage
    asyncio.run_coroutine_threadsafe(stage.disconnect(), engine.loop).result(20.0)


def make_run(daemon: Daemon) -> None:
    """Bring a stage to RUN, in mode trimmed, which needs a known hysteresis memory."""

    def running() -> bool:
        status = daemon.status()
        known = all(fault["id"] != Fault.D10 for fault in status["faults"])
        state = status["state"]
        verb, fields = NEXT.get(state, ("", {}))
        if state == State.READY and known:
            verb, fields = "mode", {"mode": "trimmed"}
        if verb:
            daemon.ask("POST", verb, fields)
        return state == State.RUN and known

    eventually(running, 60.0)
    daemon.ask("DELETE", "lease")
