"""A scan by the loop of a running stage: its samples, out of the recording of the daemon."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from piezod.config.modes import Mode
from piezod.config.waveforms.paths import Points
from piezod.errors import DataError
from piezod.experiment.live.scan_loop import RunningLoopStage
from piezod.experiment.live.stage import LiveStage
from piezod.experiment.scan.loop_lines import PartLines
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.reader import RecordedTelemetry

START = 40
"""Cycle at whose end the movement is requested."""
WAVES = {
    "x": Points(kind="points", points=((0.0, 1.0), (0.1, 3.0))),
    "y": Points(kind="points", points=((0.0, 5.0), (0.1, 4.0))),
}


class FakeRecorder:
    """Records a stage that is 0.1 µm off its command; the samples of y are 0.3 ms old."""

    def __init__(self, cycles: int, off_um: float) -> None:
        self._cycles, self._off_um = cycles, off_um

    def start(self, _label: str) -> None:
        """Begin."""

    def end(self) -> RecordedTelemetry:
        """Return the recording at 1 kHz."""
        n = self._cycles
        t_ns = 7_000_000_000 + 1_000_000 * np.arange(n)
        moving = np.arange(n) > START
        since_s = 0.001 * (np.arange(n) - START)
        axes: dict[str, dict[str, Any]] = {}
        for name, old_ns in (("x", 0), ("y", 300_000)):
            value = WAVES[name].built(0.1).value
            follow_um = np.array([value(t_s) for t_s in since_s.tolist()])
            command_um = np.where(moving, follow_um + self._off_um, value(0.0))
            axes[name] = {
                "motion": np.where(moving, 4, 3),
                "command_um": command_um,
                "position_um": command_um + 0.1,
                "sample_ns": t_ns - old_ns,
            }
        cycles = {"t_s": 1e-9 * t_ns, "t_ns": t_ns, "late_ns": np.full(n, 9)}
        header = TelemetryHeader("t", ("x", "y"), 1000.0, "", 0)
        return RecordedTelemetry(header, 0, np.empty((0, 2), np.int64), cycles, axes, {})


def stage(cycles: int = 200, off_um: float = 0.0) -> tuple[RunningLoopStage, list[Any]]:
    """Return a fake stage, and what it was asked to follow."""
    followed = list[Any]()
    fake = SimpleNamespace(
        recorder=FakeRecorder(cycles, off_um),
        follow=lambda waves, duration_s, _mode, lines=None: followed.append(
            (waves, duration_s, lines)
        ),
    )
    return RunningLoopStage(cast("LiveStage", fake), Mode.TRIMMED, ("x", "y")), followed


def test_cycles_begin_with_the_waveforms() -> None:
    """All axes are at the start before; each sample has its own instant."""
    on, followed = stage()
    cycles = on.follow(WAVES, 0.1, PartLines())

    assert [wave.level for wave in followed[0][0].values()] == [1.0, 5.0]
    assert followed[1] == (WAVES, 0.1, PartLines())
    assert cycles.t_s[[0, 50]] == pytest.approx([0.0, 0.05])
    assert cycles.sample_s[50] == pytest.approx([0.05, 0.0497])
    assert cycles.position_um[50] == pytest.approx([2.1, 4.6])
    assert set(cycles.late_ns.tolist()) == {9}


@pytest.mark.parametrize(
    ("given", "words"),
    [((START, 0.0), "does not start before"), ((100, 0.0), "ends before"), ((200, 0.01), "axis x")],
)
def test_another_recording_is_refused(given: tuple[int, float], words: str) -> None:
    """One without the start or the end, or with another command."""
    on, _ = stage(*given)
    with pytest.raises(DataError, match=words):
        on.follow(WAVES, 0.1, PartLines())
