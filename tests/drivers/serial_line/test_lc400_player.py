"""An LC.400 plays tables by its wavetables and records by its recorder."""

from collections.abc import Callable
from itertools import pairwise
from math import isnan

import numpy as np
import pytest

from piezod.devices.player import AtEnd, PlayState, Table
from piezod.errors import DeviceError
from piezod_drivers.serial_line.npoint_lc400 import codec
from piezod_drivers.serial_line.npoint_lc400.codec import FULL_SCALE, Lc400Register
from piezod_drivers.serial_line.npoint_lc400.emulation.wavetables import MID_UM
from tests.drivers.play_bench import played
from tests.drivers.serial_line.lc400_play_bench import SCALE, Lc400Bench, play_bench, sine
from tests.drivers.serial_line.linear_rig import UM_PER_V
from tests.drivers.serial_line.scripted_line import MS


def register(bench: Lc400Bench, register: int, value: int, channel: int = 1) -> None:
    """Write a register as another program would."""
    address = codec.register_address(channel, register)
    bench.controller.receive(codec.write(address, value))


def read(bench: Lc400Bench, register: int) -> int:
    """Read a register of channel 1 as another program would."""
    address = codec.register_address(1, register)
    (frame,) = bench.controller.receive(codec.read(address))
    return int.from_bytes(frame[5:9], "little", signed=True)


@pytest.mark.parametrize("n_lead_in", [0, 20])
@pytest.mark.parametrize("adds", [True, False])
def test_plays_and_records(n_lead_in: int, adds: bool) -> None:
    """Every point comes to the output in order; a position precedes its point."""
    bench = play_bench(adds=adds)
    bench.device.write([SCALE.rest if n_lead_in else SCALE.middle], bench.time.t_ns)
    bench.rig.driven_v.clear()
    loaded = bench.start(sine(n_lead_in=n_lead_in))
    assert bench.progress_to_end() == (PlayState.ENDED, 3, "")
    record, points = bench.device.recording(), played(loaded)
    points_v = 75.0 + 1.5 * points[:, 0]
    driven_v = [v for (v,) in bench.rig.driven_v]
    assert driven_v[: len(points)] == pytest.approx(points_v, abs=1e-4)
    # Then the last value is held, and becomes the command.
    assert driven_v[len(points) :] == pytest.approx([points_v[-1]] * (len(driven_v) - len(points)))
    expected_um = points_v[:-1] * UM_PER_V - MID_UM
    assert record.positions[1:, 0] == pytest.approx(expected_um, abs=1e-4)
    assert record.outputs == pytest.approx(points, abs=1e-4)
    assert (record.interval_ns, record.first_point) == (48_000, 0)
    assert len(record.positions) == len(points)


def test_two_channels_are_played_in_step() -> None:
    """One write starts both wavetables, and each channel gets its own column."""
    bench = play_bench(2)
    loaded = bench.start(sine(n_outputs=2))
    start = bench.line.sent[-1]
    starts = [codec.register_address(i, Lc400Register.WAVE_ACTIVE) for i in (1, 2)]
    assert all(codec.write(address, 1) in start for address in starts)
    bench.progress_to_end()
    record = bench.device.recording()
    assert record.outputs == pytest.approx(played(loaded), abs=1e-4)
    expected_um = (75.0 + 1.5 * played(loaded)[:-1]) * UM_PER_V - MID_UM
    assert record.positions[1:] == pytest.approx(expected_um, abs=1e-4)


def test_capabilities() -> None:
    """A point every 24 µs or a multiple, 83333 of them; only the host ends a play."""
    able = play_bench(2).device.player_capabilities()
    assert (able.shortest_interval_ns, able.interval_step_ns) == (24_000, 24_000)
    assert (able.points, able.points_shared, able.record_points) == (83_333, False, 83_333)
    assert (able.cycles, able.at_end) == (0, AtEnd.HOLDS)
    assert able.resolution == (100 / FULL_SCALE,) * 2


def test_a_play_of_a_dead_host_repeats_without_a_jump() -> None:
    """Behind its end the wavetable returns to its first point, in steps of the table's size."""
    bench = play_bench()
    loaded = bench.start(sine())
    bench.rig.driven_v.clear()
    bench.wait(700 * MS)
    driven_v = [v for (v,) in bench.rig.driven_v]
    largest = max(abs(b - a) for a, b in pairwise(played(loaded)[:, 0].tolist()))
    assert max(abs(b - a) for a, b in pairwise(driven_v)) < 1.5 * largest + 1e-3
    first_v = SCALE.volts(loaded.lead_in[0, 0])
    assert sum(v == pytest.approx(first_v, abs=1e-4) for v in driven_v) >= 3


def test_a_late_computer_fails_the_play() -> None:
    """A wavetable that was not stopped in time has begun again: its cycles are not those asked."""
    bench = play_bench()
    bench.start(sine())
    bench.wait(222 * MS)  # 15 ms of the table, 200 ms of the hold, and the way back
    found = bench.device.progress(bench.time.t_ns)
    assert found.state is PlayState.FAILED
    assert "the computer was late" in found.reason
    assert not bench.device.write([0.0], bench.time.t_ns)
    (value,) = bench.device.abort(bench.time.t_ns)
    assert SCALE.volts(value) == pytest.approx(bench.rig.drive_v[0], abs=1e-3)


def test_the_end_is_found_within_its_hold() -> None:
    """A question is asked when the table is through, even if the last one was short before."""
    bench = play_bench()
    bench.start(sine(cycles=60))
    asked: list[int] = []
    for _ in range(28):
        bench.wait(10 * MS)
        bench.line.sent.clear()
        assert bench.device.progress(bench.time.t_ns).state is PlayState.PLAYING
        asked.append(len(bench.line.sent))
    assert max(asked) == 1
    assert sum(asked) < 8
    assert bench.progress_to_end() == (PlayState.ENDED, 60, "")


def test_a_stopped_wavetable_of_another_program_fails_the_play() -> None:
    """A trigger input may stop a wavetable, too."""
    bench = play_bench()
    bench.start(sine(cycles=60))
    bench.wait(10 * MS)
    register(bench, Lc400Register.WAVE_ACTIVE, 0)
    found = bench.progress_to_end()
    assert found.state is PlayState.FAILED
    assert "has stopped the wavetable" in found.reason


def test_a_command_of_another_program_fails_the_play() -> None:
    """It would be added to the wavetable."""
    bench = play_bench()
    bench.start(sine(cycles=60))
    bench.wait(10 * MS)
    register(bench, Lc400Register.SETPOINT, 1000)
    found = bench.progress_to_end()
    assert found.state is PlayState.FAILED
    assert "another program sets a command" in found.reason
    (value,) = bench.device.abort(bench.time.t_ns)
    assert SCALE.volts(value) == pytest.approx(bench.rig.drive_v[0], abs=1e-3)


def test_a_wavetable_of_another_program_is_reported() -> None:
    """A table is not loaded while one is enabled, and not started if it does not start."""
    bench = play_bench()
    register(bench, Lc400Register.WAVE_ENABLE, 1)
    with pytest.raises(DeviceError, match="of another program is enabled"):
        bench.device.load(sine())


def test_a_wavetable_that_does_not_start_is_an_error() -> None:
    """The start is read back."""
    bench = play_bench()
    bench.device.load(sine())
    bench.device.arm()
    active = codec.register_address(1, Lc400Register.WAVE_ACTIVE)
    begin = codec.read_reply(active, 1)
    bench.line.change = lambda reply: reply.replace(begin, codec.read_reply(active, 0))
    with pytest.raises(DeviceError, match="does not start"):
        bench.device.start(bench.time.t_ns)
    bench.line.change = lambda reply: reply
    (value,) = bench.device.abort(bench.time.t_ns)
    assert SCALE.volts(value) == pytest.approx(bench.rig.drive_v[0], abs=1e-3)


def test_a_cut_record_is_refused() -> None:
    """The last sample must have been recorded."""
    bench = play_bench()
    bench.device.load(sine())
    bench.device.arm()
    bench.controller.receive(codec.write(codec.RECORD_COUNT, 300))
    bench.device.start(bench.time.t_ns)
    bench.wait(17 * MS)  # the table is through, and its end is held
    assert bench.progress_to_end().state is PlayState.ENDED
    with pytest.raises(DeviceError, match="cut off: it has less than 320 samples"):
        bench.device.recording()


def test_a_loop_input_that_is_not_the_command_is_refused() -> None:
    """An analog input that adds to the command would vanish with the wavetable."""
    bench = play_bench()
    bench.device.load(sine())
    scale = codec.register_address(1, Lc400Register.INVERSE_SCALE)
    half = int.from_bytes(np.float32(0.5).tobytes(), "little")
    bench.controller.receive(codec.write(scale, half))
    with pytest.raises(DeviceError, match=r"loop input of channel 1 is -?\d+ counts, its command"):
        bench.device.arm()


def test_loaded_table_is_the_one_that_the_controller_holds() -> None:
    """The wavetable is read back; a controller that holds another value refuses it."""
    bench = play_bench()
    first = round(SCALE.rest / 100 * FULL_SCALE)
    word = first.to_bytes(4, "little", signed=True)
    bench.line.change = lambda reply: (
        reply.replace(word, b"\x07\0\0\0", 1)
        if reply[0] == codec.Lc400Request.READ_ARRAY
        else reply
    )
    with pytest.raises(DeviceError, match=rf"channel 1 holds 7 at point 0 instead of {first}"):
        bench.device.load(sine())
    with pytest.raises(DeviceError, match="cannot arm: it is idle"):
        bench.device.arm()


@pytest.mark.parametrize(
    ("table", "what"),
    [
        (sine(cycles=900), r"900 cycles are a wavetable of 90020 points, allowed: 7\d\d\d\d at"),
        (sine(cycles=800), r"a wavetable of 80020 points, allowed: 7\d\d\d\d at an interval of 48"),
        (sine()._replace(interval_ns=50_000), "the interval of a table is 50000 ns"),
        (sine()._replace(period=np.full((5, 1), 50.1)), r"is 50\.1, allowed range -50 to 50"),
        (sine(cycles=0), "a table has 0 cycles, allowed: at least 1"),
    ],
)
def test_an_impossible_table_is_refused(table: Table, what: str) -> None:
    """The message names value and allowed range, and no wavetable is written."""
    bench = play_bench()
    bench.line.sent.clear()
    with pytest.raises(DeviceError, match=what):
        bench.device.load(table)
    assert sum(map(len, bench.line.sent)) < 100


def test_an_aborted_play_leaves_the_registers_in_order() -> None:
    """The wavetable is off, its delay is that of other programs, and the command is in force."""
    bench = play_bench()
    bench.start(sine(cycles=60))
    bench.wait(10 * MS)
    (value,) = bench.device.abort(bench.time.t_ns)
    for name in (
        Lc400Register.WAVE_ENABLE,
        Lc400Register.WAVE_ACTIVE,
        Lc400Register.WAVE_DELAY,
    ):
        assert read(bench, name) == 0
    assert read(bench, Lc400Register.SETPOINT) == round(value / 100 * FULL_SCALE)


def test_no_flipped_bit_makes_a_stop_jump() -> None:
    """Of the bits of a loop input only the lowest ones, less than 0.1 % of the span, go unseen."""
    bench = play_bench()
    bench.start(sine(cycles=10))
    bench.wait(10 * MS)
    unseen = []
    for bit in range(40, 72):  # the word of the tag's reply is first: 80 bits further is ours
        bench.line.change = _flipping(80 + bit)
        (value,) = bench.device.abort(bench.time.t_ns)
        bench.line.change = lambda reply: reply
        if not isnan(value):
            unseen.append(bit - 40)
            assert SCALE.volts(value) == pytest.approx(bench.rig.drive_v[0], abs=0.2)
            bench.device.write([SCALE.rest], bench.time.t_ns)
            bench.start(sine(cycles=10))
            bench.wait(10 * MS)
    assert unseen == list(range(11))


def _flipping(bit: int) -> Callable[[bytes], bytes]:
    """Return a change of the replies that flips a bit of the first one."""
    replies: list[bytes] = []

    def change(reply: bytes) -> bytes:
        changed = bytearray(reply)
        if not replies:
            changed[bit // 8] ^= 1 << bit % 8
        replies.append(reply)
        return bytes(changed)

    return change
