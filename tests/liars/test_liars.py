from math import isnan, nan
from pathlib import Path

import pytest

from tests.liars.config import SLEW_V_PER_S, TOLERANCE_V, identified
from tests.liars.judge import PERIOD_S, fast_points, largest_by_itself_v, steps_of
from tests.liars.process import Row
from tests.liars.table import run_lie

BOUND_V = SLEW_V_PER_S * PERIOD_S + TOLERANCE_V


def read(t_s: float, output_v: float, shown_v: float, written_v: float = 0.0) -> Row:
    """Return a read-back in a trace."""
    return Row(t_s, "read", written_v, output_v, output_v, shown_v, nan, "")


def write(t_s: float, drive_v: float, output_v: float) -> Row:
    """Return a write in a trace, which the output follows."""
    return Row(t_s, "write", drive_v, output_v, drive_v, output_v, nan, "")


def test_far_write_is_found() -> None:
    """A write that is farther from the output than slew rate, age and tolerance allow is far."""
    near = write(1.0, BOUND_V - 0.1, 0.0)
    far = write(1.0, BOUND_V + 0.1, 0.0)

    assert [step.is_far for step in steps_of([read(1.0, 0.0, 0.0), near])] == [False]
    assert [step.is_far for step in steps_of([read(1.0, 0.0, 0.0), far])] == [True]


def test_false_read_back_does_not_excuse_a_write() -> None:
    """A write is judged by the voltage on the stage, not by the one that is read back."""
    (step,) = steps_of([read(1.0, 0.0, 60.0), write(1.0, 60.0, 0.0)])

    assert step.is_far
    assert not step.honest


@pytest.mark.parametrize(
    ("own_v", "shown_v", "position_um", "witness"),
    [
        (nan, 40.0, 8.0, True),
        (40.0, 28.0, 8.0, True),
        (nan, 28.0, 8.0, False),
        (0.0, 28.0, 8.0, False),
        (nan, 28.0, nan, False),
        (nan, 140.0, 8.0, True),
    ],
)
def test_witness_is_found(own_v: float, shown_v: float, position_um: float, witness: bool) -> None:
    """A right read-back, the own last write in force, or an impossible position can tell."""
    rows = [write(0.9, own_v, 40.0), Row(1.0, "read", own_v, 40.0, 40.0, shown_v, position_um, "")]
    rows = rows[isnan(own_v) :]
    *_, step = steps_of([*rows, write(1.0, shown_v, 40.0)])

    assert step.has_witness == witness


def test_points_of_a_table_are_within_the_slew_rate() -> None:
    """The points of a table are no writes, but the first one; their steps are judged."""
    start = write(1.0, 40.0, 40.0)._replace(kind="start")
    near, far = (
        Row(1.01, "play", drive_v, 40.0, drive_v, drive_v, nan, "") for drive_v in (41.9, 42.1)
    )

    assert [step.drive_v for step in steps_of([start, near])] == [40.0]
    assert fast_points([start, near]) == []
    assert len(fast_points([start, far])) == 1


def test_fall_after_the_last_read_back_does_not_count() -> None:
    """What the output has gone by itself since it was last read back is no step by piezod."""
    fall = Row(1.001, "own", 60.0, 60.0, 0.0, 0.0, nan, "fall")
    before = [read(1.0, 60.0, 60.0), fall]
    (unseen,) = steps_of([*before, write(1.001, 60.0, 0.0)])
    (seen,) = steps_of([*before, read(1.001, 0.0, 0.0), write(1.001, 60.0, 0.0)])

    assert unseen.distance_v == 0.0
    assert seen.is_far
    assert largest_by_itself_v(before) == 60.0


@pytest.mark.chaos
@pytest.mark.parametrize(
    ("lie", "case"),
    [
        ("output stuck", "goto, stop"),
        ("output stuck", "estop"),
        ("off 1 s, refused, back at 0 V", "RUN at rest"),
        ("read-back false 60 V", "SAFE, arm, goto"),
        ("read-back stuck", "identify"),
        ("read-back scaled 1.3", "kill -9 of all, safe"),
        ("off 1 s, acknowledged, back at 0 V", "play, as it is loaded"),
        ("read-back false 140 V", "play, stop"),
        ("read-back scaled 0.7", "play, its end"),
    ],
)
def test_lie(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, lie: str, case: str) -> None:
    """While an amplifier lies, no write is far from its output; afterwards the stage comes home."""
    model = identified(tmp_path_factory.getbasetemp())
    (result,) = run_lie(tmp_path / "bench", model, lie, [case])

    assert not result.broken, result
