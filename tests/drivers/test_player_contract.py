"""What every player promises."""

from collections.abc import Iterator
from math import inf, nan

import numpy as np
import pytest

from piezod.devices.player import AtEnd, Player, PlayState
from piezod.errors import DeviceError, PlayCancelledError
from tests.drivers.play_bench import Cancelling
from tests.drivers.player_benches import BENCHES, OpenPlayer

SETTLE_NS = 20_000_000


@pytest.fixture(params=BENCHES)
def bench(request: pytest.FixtureRequest) -> Iterator[OpenPlayer]:
    """Open each player in turn."""
    with BENCHES[request.param]() as opened:
        yield opened


def read_back(bench: OpenPlayer) -> float:
    """Return the settled value of the output."""
    bench.wait(SETTLE_NS)
    return bench.device.read_back(bench.now_ns())[0]


def test_it_is_a_player(bench: OpenPlayer) -> None:
    """The device has all methods, and its capabilities are possible ones."""
    assert isinstance(bench.device, Player)
    able = bench.device.player_capabilities()
    assert 0 < able.shortest_interval_ns <= able.longest_interval_ns
    assert able.interval_step_ns > 0
    assert able.points > 0
    assert able.record_points > 0
    assert len(able.resolution) == 1


def test_a_play_ends_by_itself_after_its_cycles(bench: OpenPlayer) -> None:
    """The state is that of each step, and the number of complete cycles that of the table."""
    device, table = bench.device, bench.table(cycles=3)
    device.load(table)
    assert device.progress(bench.now_ns()).state is PlayState.LOADED
    device.arm()
    assert device.progress(bench.now_ns()).state is PlayState.ARMED
    device.start(bench.now_ns())
    assert device.progress(bench.now_ns())[:2] == (PlayState.PLAYING, 0)

    assert bench.finish(table) == (PlayState.ENDED, 3, "")


def test_record_covers_the_play(bench: OpenPlayer) -> None:
    """There is a sample for each point from the first to the last one, at the table's interval."""
    table = bench.table()
    bench.start(table)
    bench.finish(table)
    record = bench.device.recording()

    assert record.interval_ns == table.interval_ns
    assert record.first_point == 0
    assert len(record.positions) >= len(table.lead_in) + 3 * len(table.period)
    assert np.isfinite(record.positions).all()


def test_loaded_table_is_the_asked_one_within_the_resolution(bench: OpenPlayer) -> None:
    """The device rounds each point to its converter, and reports the rounded ones."""
    table = bench.table()
    loaded = bench.device.load(table)
    (step,) = bench.device.player_capabilities().resolution

    assert loaded.interval_ns == table.interval_ns
    assert loaded.cycles == table.cycles
    for asked, played in ((table.lead_in, loaded.lead_in), (table.period, loaded.period)):
        assert played.shape == asked.shape
        assert np.max(np.abs(played - asked)) <= 0.51 * step


def test_nothing_moves_before_the_start(bench: OpenPlayer) -> None:
    """Neither loading nor arming changes the output, and writes are accepted until the start."""
    device = bench.device
    assert device.write([1.0], bench.now_ns())
    before = read_back(bench)
    device.load(bench.table())
    device.arm()

    assert read_back(bench) == pytest.approx(before, abs=bench.settled)
    assert device.write([1.0], bench.now_ns())


def test_writes_are_refused_while_playing(bench: OpenPlayer) -> None:
    """A setpoint during a play changes nothing; after it, writes are accepted again."""
    table = bench.table()
    bench.start(table)
    bench.wait(table.duration_ns // 2)
    assert not bench.device.write([0.0], bench.now_ns())

    bench.finish(table)
    assert bench.device.write([0.0], bench.now_ns())


def test_abort_stops_and_holds(bench: OpenPlayer) -> None:
    """The value in force is returned, stays, and is one of the table; writes are accepted again."""
    table = bench.table(cycles=100)
    loaded = bench.start(table)
    bench.wait(table.duration_ns // 10)
    (in_force,) = bench.device.abort(bench.now_ns())

    values = np.concatenate((loaded.lead_in, loaded.period))
    (step,) = bench.device.player_capabilities().resolution
    assert np.min(np.abs(values - in_force)) < 1e-6 + step
    assert bench.device.progress(bench.now_ns()).state is PlayState.IDLE
    assert read_back(bench) == pytest.approx(in_force, abs=bench.settled)
    assert bench.device.write([in_force], bench.now_ns())


def test_abort_may_be_called_at_any_time(bench: OpenPlayer) -> None:
    """Without a play, loaded, armed, twice: it never raises and never moves the output."""
    device = bench.device
    assert device.write([1.0], bench.now_ns())
    bench.wait(SETTLE_NS)

    def load() -> None:
        device.load(bench.table())

    for steps in ((), (load,), (load, device.arm), (load, device.arm)):
        for step in steps:
            step()
        (in_force,) = device.abort(bench.now_ns())
        assert in_force == pytest.approx(1.0, abs=bench.settled)

    assert read_back(bench) == pytest.approx(1.0, abs=bench.settled)


def test_output_at_the_end_is_the_promised_one(bench: OpenPlayer) -> None:
    """A device that holds keeps the last value of the period."""
    table = bench.table()
    loaded = bench.start(table)
    bench.finish(table)

    if bench.device.player_capabilities().at_end is AtEnd.HOLDS:
        last = float(loaded.period[-1, 0])
        assert read_back(bench) == pytest.approx(last, abs=bench.settled)


@pytest.mark.parametrize("bad", [nan, inf, None])
@pytest.mark.parametrize("part", ["lead_in", "period"])
def test_table_beyond_the_range_is_refused_and_not_loaded(
    bench: OpenPlayer, part: str, bad: float | None
) -> None:
    """The text names the point; afterwards nothing is loaded, and nothing has moved."""
    table, before = bench.table(), read_back(bench)
    values = getattr(table, part).copy()
    values[7, 0] = bench.outside if bad is None else bad
    with pytest.raises(DeviceError, match="7"):
        bench.device.load(table._replace(**{part: values}))

    with pytest.raises(DeviceError):
        bench.device.arm()
    assert read_back(bench) == pytest.approx(before, abs=bench.settled)


def test_table_that_does_not_fit_is_refused(bench: OpenPlayer) -> None:
    """Interval, number of points, of columns and of cycles must be possible."""
    device, table = bench.device, bench.table()
    able = device.player_capabilities()
    two_columns = np.tile(table.period, (1, 2))
    for wrong in (
        table._replace(interval_ns=able.shortest_interval_ns - 1),
        table._replace(interval_ns=0),
        table._replace(period=np.empty((0, 1))),
        table._replace(period=np.zeros((able.points + 1, 1))),
        table._replace(period=two_columns, lead_in=np.tile(table.lead_in, (1, 2))),
        table._replace(cycles=0),
    ):
        with pytest.raises(DeviceError):
            device.load(wrong)


def test_steps_out_of_order_are_refused(bench: OpenPlayer) -> None:
    """Each step needs the one before it, and a table is not loaded while another one is played."""
    device, table = bench.device, bench.table(cycles=100)
    for step in (
        device.arm,
        lambda: device.start(bench.now_ns()),
        device.recording,
        lambda: device.replace(table.period),
    ):
        with pytest.raises(DeviceError):
            step()
    device.load(table)
    with pytest.raises(DeviceError):
        device.start(bench.now_ns())
    device.arm()
    device.start(bench.now_ns())
    with pytest.raises(DeviceError):
        device.load(table)
    with pytest.raises(DeviceError):
        device.recording()
    device.abort(bench.now_ns())
    with pytest.raises(DeviceError):
        device.recording()


def test_a_second_play_follows_the_first(bench: OpenPlayer) -> None:
    """After a play that has ended, and after one that was aborted, the next one is complete."""
    table = bench.table()
    bench.start(table)
    bench.finish(table)
    bench.device.recording()
    bench.start(table)
    bench.device.abort(bench.now_ns())
    bench.start(table)

    assert bench.finish(table) == (PlayState.ENDED, 3, "")
    assert len(bench.device.recording().positions) >= len(table.lead_in) + 3 * len(table.period)


def test_cancelled_load_leaves_nothing(bench: OpenPlayer) -> None:
    """Nothing is loaded, the output stays and takes setpoints, and the next play is complete."""
    device, table, counted = bench.device, bench.table(lead_in=60, period=400), Cancelling()
    assert device.write([1.0], bench.now_ns())
    before = read_back(bench)
    device.load(table, counted)
    for at in sorted({0, counted.calls // 2, counted.calls - 1}):
        with pytest.raises(PlayCancelledError):
            device.load(table, Cancelling(at))

        assert device.abort(bench.now_ns()) == pytest.approx((before,), abs=bench.settled)
        assert device.progress(bench.now_ns()).state is PlayState.IDLE
        with pytest.raises(DeviceError):
            device.arm()
        assert device.write([1.0], bench.now_ns())
    assert read_back(bench) == pytest.approx(before, abs=bench.settled)
    bench.start(table)
    assert bench.finish(table) == (PlayState.ENDED, 3, "")


def test_cancelled_record_can_be_read_again(bench: OpenPlayer) -> None:
    """The output stays at the end of the play, and the whole record is there afterwards."""
    device, table, counted = bench.device, bench.table(period=400), Cancelling()
    bench.start(table)
    bench.finish(table)
    record = device.recording(counted)
    for at in sorted({0, counted.calls // 2, counted.calls - 1}):
        with pytest.raises(PlayCancelledError):
            device.recording(Cancelling(at))
        assert device.abort(bench.now_ns()) == pytest.approx(
            (table.period[-1, 0],), abs=bench.settled
        )

    again = device.recording()
    assert np.array_equal(again.positions, record.positions)


def test_deactivated_device_plays_nothing(bench: OpenPlayer) -> None:
    """Deactivating ends a play, and every step is refused afterwards."""
    device, table = bench.device, bench.table(cycles=100)
    bench.start(table)
    device.deactivate(bench.now_ns())

    for step in (lambda: device.load(table), device.arm, device.recording):
        with pytest.raises(DeviceError):
            step()
    device.abort(bench.now_ns())
