"""User axes as the daemon tells them."""

from pathlib import Path

import pytest

from piezod.config.states import State
from piezod.daemon.stage.connection import LoopConnection
from piezod.daemon.stage.errors import BadValueError
from piezod.daemon.stage.status import PATH, status
from piezod.messages import requests as rq
from piezod.messages.answers import Status
from piezod.telemetry.encoder import encode_axis, encode_cycle
from piezod.telemetry.layout import Layout
from piezod.telemetry.record import CycleHeader
from piezod.telemetry.ring import RingWriter
from piezod.telemetry.shared_map import create
from piezod.telemetry.words import Word
from tests.control.coupled_stage import TABLE, CoupledStage


def _connected(stage: CoupledStage, folder: Path) -> tuple[LoopConnection, RingWriter]:
    shared = create(folder / "loop.map", Layout.of(stage.config))
    shared.words[Word.LOOP_STATE] = list(State).index(State.RUN)
    return LoopConnection(stage.config, shared), RingWriter(shared)


def _shown(stage: CoupledStage, folder: Path) -> Status:
    """Return the status after some cycles, by way of the shared memory."""
    loop, ring = _connected(stage, folder)
    for _ in range(PATH):
        record = stage.cycle()
        zeros = dict.fromkeys(CycleHeader._fields, 0)
        flags = {"state": record.state, "shadow": False, "written": True}
        header = CycleHeader(**{**zeros, **flags})  # type: ignore[arg-type]
        values = [*encode_cycle(header)]
        for axis in record.axes:
            values += encode_axis(axis)
        ring.append(values)
    return status("bench", loop.config, loop.shared, loop.newest(PATH), loop.learned)


def test_status_has_the_user_axes_first(tmp_path: Path) -> None:
    """User axes come first, in their units; each actuator says which of them move it."""
    stage = CoupledStage(TABLE, "abc", share=0.0)
    stage.ask(rq.Path(points=({"z": 5.0, "rx": 200.0},)))
    stage.run(1.0)
    found = _shown(stage, tmp_path)
    assert list(found.axes) == ["z", "rx", "ry", "a", "b", "c"]
    assert found.axes["rx"].unit == "µrad"
    assert found.axes["rx"].position_um == pytest.approx(200.0)
    assert found.axes["rx"].drive_v is None
    assert found.axes["a"].moved_by == "z, rx, ry"
    assert found.axes["a"].drive_v is not None
    assert found.contour_um == pytest.approx(0.0, abs=1e-6)


def test_setpoints_of_user_axes_have_their_ranges(tmp_path: Path) -> None:
    """A set-point beyond the range of a user axis is refused in its unit."""
    stage = CoupledStage(TABLE, "abc", share=0.0)
    loop, _ = _connected(stage, tmp_path)
    assert loop.range_um("rx") == (-500.0, 500.0)
    assert list(loop.places)[:3] == ["z", "rx", "ry"]
    with pytest.raises(BadValueError) as error:
        loop.stream_setpoint({"rx": 600.0})
    assert "600 µrad" in error.value.what
    assert "µrad" in error.value.remedy
