"""What may go wrong during a play, on every emulated device that plays."""

from collections.abc import Callable
from itertools import pairwise, product
from math import isnan

import pytest

from piezod.devices.interface import Wiring
from piezod.devices.player import PlayState
from piezod.errors import DeviceError, PlayCancelledError
from tests.drivers.modbus import play_bench as modbus_bench
from tests.drivers.play_bench import Cancelling, PlayBench, played
from tests.drivers.serial_line import lc400_play_bench, nv200_play_bench, pi_play_bench
from tests.drivers.serial_line.linear_rig import STEP_NS
from tests.drivers.serial_line.scripted_line import MS

BENCHES: dict[str, Callable[[], PlayBench]] = {
    "labjack-t7": modbus_bench.play_bench,
    "pi-gcs2": lambda: pi_play_bench.play_bench(wave_end="holds"),
    "lc400": lc400_play_bench.play_bench,
    "lc400-replaces": lambda: lc400_play_bench.play_bench(adds=False),
    "lc400-pauses": lambda: lc400_play_bench.play_bench(drops=False),
    "psj-nv200": lambda: nv200_play_bench.play_bench(wave_end="holds"),
}
LONG = 40
"""Cycles of a play of 0.2 s."""
IN_MID_PLAY_NS = 33 * MS
"""In the second cycle, behind the held points and the lead-in."""


@pytest.fixture(params=BENCHES)
def bench(request: pytest.FixtureRequest) -> PlayBench:
    """Open each device in turn."""
    return BENCHES[request.param]()


def start_and_wait(bench: PlayBench) -> None:
    """Start a long play; stop waiting in its second cycle."""
    bench.start(bench.scale.sine(cycles=LONG))
    bench.wait(IN_MID_PLAY_NS)


def assert_in_force(bench: PlayBench, value: float) -> None:
    """Assert that a value is that of the rig."""
    tolerance = abs(bench.scale.volts(bench.scale.tolerance) - bench.scale.volts(0.0))
    assert bench.scale.volts(value) == pytest.approx(bench.rig.drive_v[0], abs=tolerance)


def assert_holds(bench: PlayBench, value: float) -> None:
    """Assert that a value is that of the rig, which stays, and that setpoints are accepted."""
    held_v = list(bench.rig.drive_v)
    assert_in_force(bench, value)
    bench.wait(50 * MS)
    assert bench.rig.drive_v == held_v


@pytest.mark.parametrize("late_ns", [0, 300, 999])
def test_points_are_at_the_steps_of_the_rig(bench: PlayBench, late_ns: int) -> None:
    """Each play has the same delay between its points and their effect."""
    bench.time.t_ns += late_ns
    bench.start(bench.scale.sine())
    bench.rig.driven_ns.clear()
    bench.wait(IN_MID_PLAY_NS)
    assert len(bench.rig.driven_ns) > 100
    assert {t_ns % STEP_NS for t_ns in bench.rig.driven_ns} == {0}


def test_abort_at_a_moving_point_holds(bench: PlayBench) -> None:
    """The output keeps the value at which the play stops, without a jump; it is read back."""
    start_and_wait(bench)
    (value,) = bench.device.abort(bench.time.t_ns)
    assert_holds(bench, value)
    assert bench.device.progress(bench.time.t_ns).state is PlayState.IDLE
    assert list(bench.device.read_back(bench.time.t_ns)) == pytest.approx([value])
    assert bench.device.write([value], bench.time.t_ns)
    assert frozenset().union(*bench.device.status(bench.time.t_ns)) == frozenset()
    with pytest.raises(DeviceError, match="read a record: it is idle"):
        bench.device.recording()


def test_no_step_is_larger_than_one_of_the_table(bench: PlayBench) -> None:
    """From the setpoint before to one after a play, and in an aborted one, nothing jumps."""
    first, table = bench.scale.rest, bench.scale.sine()
    values = [first, *played(table)[:, 0].tolist()]
    largest_v = max(abs(bench.scale.volts(b) - bench.scale.volts(a)) for a, b in pairwise(values))
    assert bench.device.write([first], bench.time.t_ns)
    bench.rig.driven_v.clear()
    bench.start(table)
    bench.progress_to_end()
    assert bench.device.write([values[-1]], bench.time.t_ns)
    driven_v = [bench.scale.volts(first), *(v for (v,) in bench.rig.driven_v)]
    assert max(abs(b - a) for a, b in pairwise(driven_v)) < 1.01 * largest_v

    assert bench.device.write([first], bench.time.t_ns)
    bench.rig.driven_v.clear()
    start_and_wait(bench)
    (value,) = bench.device.abort(bench.time.t_ns)
    assert bench.device.write([value], bench.time.t_ns)
    driven_v = [bench.scale.volts(first), *(v for (v,) in bench.rig.driven_v)]
    assert max(abs(b - a) for a, b in pairwise(driven_v)) < 1.01 * largest_v


def test_a_play_after_an_aborted_one_begins_at_its_first_point(bench: PlayBench) -> None:
    """Nothing goes on where the play before was stopped."""
    start_and_wait(bench)
    bench.device.abort(bench.time.t_ns)
    assert bench.device.write([bench.scale.rest], bench.time.t_ns)
    bench.rig.driven_v.clear()
    loaded = bench.start(bench.scale.sine())
    assert bench.progress_to_end() == (PlayState.ENDED, 3, "")
    driven_v = [v for (v,) in bench.rig.driven_v]
    points_v = [bench.scale.volts(value) for value in played(loaded)[:, 0]]
    begin = next(i for i, v in enumerate(driven_v) if v == pytest.approx(points_v[1], abs=1e-3)) - 1
    assert driven_v[begin : begin + len(points_v)] == pytest.approx(points_v, abs=1e-3)
    # Held points, and the last one once more, may surround them.
    before, after = driven_v[:begin], driven_v[begin + len(points_v) :]
    assert before == pytest.approx([points_v[0]] * len(before), abs=1e-3)
    assert after == pytest.approx([points_v[-1]] * len(after), abs=1e-3)


def test_a_pulled_cable_leaves_the_voltage_unknown(bench: PlayBench) -> None:
    """A device out of reach plays on; activating it again stops it where it is."""
    start_and_wait(bench)
    bench.unplug(pulled=True)
    assert bench.device.progress(bench.time.t_ns).state is PlayState.FAILED
    assert isnan(bench.device.abort(bench.time.t_ns)[0])
    assert not bench.device.write([bench.scale.rest], bench.time.t_ns)
    moving_v = list(bench.rig.drive_v)
    bench.wait(11 * MS)
    assert bench.rig.drive_v != moving_v
    bench.unplug(pulled=False)
    bench.device.close()
    bench.opened()
    (value,) = bench.device.read_back(bench.time.t_ns)
    assert_holds(bench, value)
    assert bench.device.write([value], bench.time.t_ns)


@pytest.mark.parametrize("measures", [True, False])
def test_a_play_of_a_dead_host_is_stopped_before_anything_is_set(
    bench: PlayBench, measures: bool
) -> None:
    """The next process finds the play, stops it when it takes control, and reads the output."""
    start_and_wait(bench)
    wiring = bench.wiring if measures else Wiring((), bench.wiring.outputs)
    other = bench.connect(wiring)
    other.open()
    moving_v = list(bench.rig.drive_v)
    bench.wait(3 * MS)
    assert bench.rig.drive_v != moving_v
    other.activate(bench.time.t_ns)
    (value,) = other.read_back(bench.time.t_ns)
    assert_holds(bench, value)
    assert other.write([value], bench.time.t_ns)
    assert_in_force(bench, value)


WRONG: dict[str, Callable[[bytes], bytes]] = {
    "lost": lambda _: b"",
    "garbled": lambda reply: bytes(byte ^ 0x15 for byte in reply),
    "cut": lambda reply: reply[:-2],
    "another": lambda reply: reply.replace(b"1", b"7").replace(b"\x00", b"\x02"),
}


def is_variant(name: str, wrong: str) -> bool:
    """Return whether an LC.400 replaces or pauses, and its answers are not just lost."""
    return name.startswith("lc400-") and wrong != "lost"


@pytest.mark.parametrize(
    ("bench", "wrong"),
    [
        pytest.param(name, wrong, marks=[pytest.mark.stress] if is_variant(name, wrong) else [])
        for name, wrong in product(BENCHES, WRONG)
    ],
    indirect=["bench"],
)
@pytest.mark.few(8)
def test_wrong_answers_never_give_a_wrong_voltage(bench: PlayBench, wrong: str) -> None:
    """Without a right answer writes are refused and the voltage is unknown; later it is found."""
    start_and_wait(bench)
    bench.line.change = WRONG[wrong]
    for _ in range(5):
        bench.wait(30 * MS)
        assert bench.device.progress(bench.time.t_ns).state is not PlayState.ENDED
        assert not bench.device.write([bench.scale.rest], bench.time.t_ns)
    (value,) = bench.device.abort(bench.time.t_ns)
    if not isnan(value):
        assert_in_force(bench, value)
    bench.line.change = lambda reply: reply
    bench.wait(1_000 * MS)
    if bench.device.lost:
        bench.device.close()
        bench.opened()
    for _ in range(3):  # late replies of other requests are dropped first
        (value,) = bench.device.abort(bench.time.t_ns)
    assert_holds(bench, value)
    assert bench.device.write([value], bench.time.t_ns)


def test_a_start_without_an_answer_is_stopped(bench: PlayBench) -> None:
    """The device may play, so it counts as playing until its stop is confirmed."""
    bench.device.load(bench.scale.sine(cycles=LONG))
    bench.device.arm()
    bench.line.change = lambda _: b""
    with pytest.raises(DeviceError, match="cannot start"):
        bench.device.start(bench.time.t_ns)
    bench.line.change = lambda reply: reply
    assert not bench.device.write([bench.scale.rest], bench.time.t_ns)
    for _ in range(100):  # until a late reply can no longer come
        (value,) = bench.device.abort(bench.time.t_ns)
        if not isnan(value):
            break
        bench.wait(100 * MS)
    assert_holds(bench, value)
    assert bench.device.write([value], bench.time.t_ns)


def test_a_cancelled_load_or_record_leaves_the_bus_in_step(bench: PlayBench) -> None:
    """It ends between two exchanges: the next reply is that of the next request; no fault."""
    table, sent = bench.scale.sine(n=400, cycles=1), bench.line.sent
    counted, before = Cancelling(), len(sent)
    bench.device.load(table, counted)
    whole, before = len(sent) - before, len(sent)
    with pytest.raises(PlayCancelledError):
        bench.device.load(table, Cancelling(counted.calls // 2))
    assert len(sent) - before < 0.8 * whole
    assert_holds(bench, bench.device.abort(bench.time.t_ns)[0])

    bench.start(table)
    assert bench.progress_to_end() == (PlayState.ENDED, 1, "")
    counted = Cancelling()
    bench.device.recording(counted)
    with pytest.raises(PlayCancelledError):
        bench.device.recording(Cancelling(counted.calls // 2))
    assert_holds(bench, bench.device.abort(bench.time.t_ns)[0])
    assert frozenset().union(*bench.device.status(bench.time.t_ns)) == frozenset()


def test_a_cable_pulled_while_a_table_is_loaded_moves_nothing(bench: PlayBench) -> None:
    """Loading fails, and another load succeeds when the cable is back."""
    before_v, table = list(bench.rig.drive_v), bench.scale.sine()
    bench.device.load(table)
    sent = len(bench.line.sent)
    cut = len(bench.line.sent) // 2

    def pull(reply: bytes) -> bytes:
        bench.line.unplugged = len(bench.line.sent) > sent + cut
        return reply

    bench.line.change = pull
    with pytest.raises(DeviceError):
        bench.device.load(table)
    assert bench.rig.drive_v == before_v
    bench.line.change = lambda reply: reply
    bench.wait(10 * MS)
    bench.unplug(pulled=False)
    bench.device.close()
    bench.opened()
    bench.start(table)
    assert bench.progress_to_end() == (PlayState.ENDED, 3, "")
