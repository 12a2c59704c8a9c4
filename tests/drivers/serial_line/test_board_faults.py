"""What a player board and its driver do about faults; the DAC of the emulated board is the witness.

Faults come in at the line, at the processor or at SPI.
"""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from piezod.devices.player import PlayState
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.serial_line.piezo_board import codec
from piezod_drivers.serial_line.piezo_board.emulation.build import build, missing, sources
from piezod_drivers.serial_line.piezo_board.emulator import BoardEmulator
from tests.drivers.serial_line.board_play_bench import BoardBench, needs_board, play_bench, sine
from tests.drivers.serial_line.linear_rig import bench as linear_bench
from tests.drivers.serial_line.scripted_line import MS

pytestmark = needs_board
SECOND = 1000 * MS


@pytest.fixture
def bench() -> BoardBench:
    """Return an active board with its output at 1 V."""
    opened = play_bench()
    assert opened.device.write([1.0], opened.time.t_ns)
    return opened


def flags(bench: BoardBench) -> frozenset[DeviceFlag]:
    """Return the flags of the output, after a reading."""
    bench.device.read(bench.time.t_ns)
    return bench.device.status(bench.time.t_ns)[-1]


def plays(bench: BoardBench) -> None:
    """Start a play that does not end within a test, and let it go on for a while."""
    bench.start(sine(cycles=100_000))
    bench.wait(30 * MS)
    assert bench.device.progress(bench.time.t_ns).state is PlayState.PLAYING


def test_output_is_safe_before_anything_else() -> None:
    """The first thing that a board does is to set its safe voltage, within half a millisecond."""
    shared, rig, time = linear_bench()
    board = BoardEmulator(shared, "", build(defines="-DPLAYER_SAFE=13107"))
    time.t_ns += MS // 2
    board.due()
    assert rig.driven_v == [[pytest.approx(30.0, abs=0.01)]]


@pytest.mark.sees("piezo_board", "A9")
def test_host_that_falls_silent_leaves_the_safe_voltage(bench: BoardBench) -> None:
    """The output goes there in small steps; setpoints are refused until it was taken over again."""
    begun = len(bench.driven_codes)
    bench.wait(3 * SECOND)
    steps = np.diff([round(1.0 / 5.0 * 65_535), *bench.driven_codes[begun:]])
    assert bench.driven_codes[-1] == 0
    assert np.abs(steps).max() <= 262
    assert DeviceFlag.WATCHDOG_TRIPPED in flags(bench)
    assert not bench.device.write([1.0], bench.time.t_ns)
    assert DeviceFlag.DISCONNECTED in bench.device.status(bench.time.t_ns)[-1]
    assert bench.driven_codes[-1] == 0


def test_host_that_dies_in_mid_play_leaves_the_safe_voltage(bench: BoardBench) -> None:
    """The play ends, the lines fall, and the output goes to the safe voltage."""
    plays(bench)
    bench.wait(3 * SECOND)
    assert bench.driven_codes[-1] == 0
    assert not bench.board.processor.plays
    progress = bench.device.progress(bench.time.t_ns)
    assert progress.state is PlayState.FAILED
    assert "watchdog" in progress.reason


@pytest.mark.sees("piezo_board", "A7")
def test_reset_is_told_and_leaves_the_safe_voltage(bench: BoardBench) -> None:
    """Nothing is driven before the board was opened and activated again."""
    bench.board.processor.reset()
    bench.wait(10 * MS)
    assert bench.driven_codes[-1] == 0
    assert DeviceFlag.RESTARTED in flags(bench)
    assert not bench.device.write([1.0], bench.time.t_ns)
    bench.device.close()
    bench.opened()
    assert bench.device.write([1.0], bench.time.t_ns)
    assert not flags(bench)


def test_reset_in_mid_play_fails_the_play(bench: BoardBench) -> None:
    """The safe voltage is in force at once, and the cause is named."""
    plays(bench)
    bench.board.processor.reset()
    bench.wait(200 * MS)
    assert bench.driven_codes[-1] == 0
    progress = bench.device.progress(bench.time.t_ns)
    assert progress.state is PlayState.FAILED
    assert "reset" in progress.reason


def test_setpoint_after_an_unseen_reset_is_refused_by_the_board(bench: BoardBench) -> None:
    """The board itself refuses, although the driver has not asked for its state since."""
    bench.board.processor.reset()
    bench.wait(10 * MS)
    assert not bench.device.write([1.0], bench.time.t_ns)
    assert DeviceFlag.RESTARTED in bench.device.status(bench.time.t_ns)[-1]
    assert bench.driven_codes[-1] == 0


def test_half_a_table_is_not_played(bench: BoardBench) -> None:
    """Where data stop on the line the load fails; what was loaded before is not played either."""
    bench.device.load(sine())
    send = bench.line.send

    def cut(data: bytes) -> None:
        send(data[:100])

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(bench.line, "send", cut)
        with pytest.raises(DeviceError, match=r"refuses: short|no reply"):
            bench.device.load(sine())
    with pytest.raises(DeviceError):
        bench.device.arm()
    bench.wait(300 * MS)
    bench.start(sine())
    assert bench.progress_to_end().state is PlayState.ENDED


@pytest.mark.parametrize("place", [0, 57, -1])
def test_flipped_bit_in_a_table_is_refused(bench: BoardBench, place: int) -> None:
    """The board compares the checksum of the data."""
    send = bench.line.send

    def flip(data: bytes) -> None:
        changed = bytearray(data)
        if not data.startswith(b"@"):
            changed[place] ^= 4
        send(bytes(changed))

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(bench.line, "send", flip)
        with pytest.raises(DeviceError, match="refuses: crc"):
            bench.device.load(sine())


def test_table_that_changed_in_memory_is_not_started(bench: BoardBench) -> None:
    """The board compares the whole table before it plays."""
    bench.device.load(sine())
    part = codec.with_crc(codec.data_bytes([7]))
    bench.board.receive(codec.request(1, "T 5 1"))
    bench.board.receive(part)
    with pytest.raises(DeviceError, match="refuses: table"):
        bench.device.arm()


def test_flipped_bit_in_a_request_moves_nothing(bench: BoardBench) -> None:
    """Whatever bit of a setpoint flips: the output is the old one or the new one."""
    send = bench.line.send
    request = codec.request(1, "V 13500")
    for place in range(len(request) - 1):
        for bit in range(8):

            def flip(data: bytes, place: int = place, bit: int = bit) -> None:
                changed = bytearray(data)
                changed[place] ^= 1 << bit
                send(bytes(changed))

            with pytest.MonkeyPatch.context() as patched:
                patched.setattr(bench.line, "send", flip)
                assert not bench.device.write([13500 / 65535 * 5.0], bench.time.t_ns)
        bench.device.read(bench.time.t_ns)
    assert bench.driven_codes[-1] == 13107


def test_noise_on_the_line_moves_nothing(bench: BoardBench) -> None:
    """Random bytes, also the beginnings of requests: afterwards the board answers as before."""
    noise = np.random.default_rng(1)
    before = len(bench.driven_codes)
    for _ in range(50):
        bench.board.receive(noise.bytes(40) + b"\nV 5\nON\nT 0 128\nG\n")
        bench.wait(5 * MS)
        bench.device.read(bench.time.t_ns)
    bench.wait(300 * MS)
    assert bench.device.write([1.0], bench.time.t_ns)
    assert len(bench.driven_codes) == before


def test_lost_bytes_are_told(bench: BoardBench) -> None:
    """Bytes that come faster than the receiver takes them are noticed, and no half line acts."""
    bench.board.processor.feed(b"?\n" * 500)
    bench.wait(100 * MS)
    assert bench.driven_codes[-1] == 13107
    assert bench.device.write([1.0], bench.time.t_ns)


def test_late_point_refuses_the_record() -> None:
    """An interval for which the processor has no time is found by the board, and named."""
    bench = play_bench(defines="-DPORT_SHORTEST=400")
    table = sine(cycles=1000)._replace(interval_ns=25_000)
    bench.start(table)
    progress = bench.progress_to_end()
    assert progress.state is PlayState.FAILED
    assert "late" in progress.reason or "reset" in progress.reason
    with pytest.raises(DeviceError):
        bench.device.recording()


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda text: text.replace('"I piezod-player', '"I other-thing'), "no player board"),
        (lambda text: text.replace("PLAYER_PROTOCOL)", "0)"), "speaks protocol 0"),
    ],
    ids=["foreign", "older"],
)
def test_other_firmware_is_named(change: Callable[[str], str], cause: str, tmp_path: Path) -> None:
    """A foreign or an older firmware is refused at the opening; nothing is driven."""
    folder = tmp_path / "player"
    shutil.copytree(sources(), folder)
    file = folder / "core" / "commands.c"
    text = file.read_text(encoding="utf-8")
    assert change(text) != text
    file.write_text(change(text), encoding="utf-8")
    with pytest.raises(DeviceError, match=cause):
        play_bench(folder=folder)


def test_output_beyond_the_range_of_the_firmware_is_refused() -> None:
    """The range that a firmware was compiled with holds for setpoints and for tables."""
    bench = play_bench(defines="-DPLAYER_HIGHEST=32768")
    assert bench.device.capabilities().ranges[0][1] == pytest.approx(2.5, abs=1e-4)
    assert not bench.device.write([2.6], bench.time.t_ns)
    assert bench.device.write([1.0], bench.time.t_ns)
    reply = bench.board.receive(codec.request(1, "V 40000"))[0]
    assert b"E range" in reply
    assert max(bench.driven_codes) <= 32768


@pytest.mark.sees("piezo_board", "S7")
def test_saturated_input_is_told(bench: BoardBench) -> None:
    """A sample at the end of the converter is invalid."""
    bench.rig.at_um = [50.0]
    (sample,) = bench.device.read(bench.time.t_ns)
    assert not sample.valid
    assert DeviceFlag.SATURATED in bench.device.status(bench.time.t_ns)[0]


def test_lines_mark_points_lines_and_the_frame() -> None:
    """A pulse at every other point, one in each period, and a frame during the play."""
    bench = play_bench({"pulses": {"point": 2}})
    bench.board.processor.forget()
    table = bench.start(sine(n=100, cycles=3))
    assert bench.progress_to_end().state is PlayState.ENDED
    seen = bench.board.processor.seen
    assert (seen.points, seen.lines, seen.frames) == (150, 3, 1)
    assert len(table.period) == 100


def test_an_edge_starts_a_play() -> None:
    """An armed play waits for an edge of the trigger input; its first point follows at once."""
    bench = play_bench({"play_on": "start edge"})
    bench.start(sine(cycles=2))
    bench.wait(50 * MS)
    assert bench.rig.driven_v[-1] == [0.0]
    bench.board.processor.edge()
    assert bench.progress_to_end().state is PlayState.ENDED
    assert len(bench.device.recording().positions) == 220


def test_each_edge_is_a_point() -> None:
    """With `step edges` the table goes on at each edge, whatever the time between them."""
    bench = play_bench({"play_on": "step edges"})
    table = bench.start(sine(n=10, cycles=1, n_lead_in=0))
    bench.wait(200 * MS)  # the board is ahead of the clock by the time of the exchanges
    for i, value in enumerate(table.period[:, 0]):
        bench.board.processor.edge()
        bench.wait((1 + i) * MS)
        assert bench.rig.drive_v[0] == pytest.approx(30.0 * value, abs=1e-6)
        bench.device.progress(bench.time.t_ns)
    bench.wait(100 * MS)
    assert bench.device.progress(bench.time.t_ns).state is PlayState.ENDED


def test_missing_compiler_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the compilers the board cannot be emulated; the text says what to install."""
    monkeypatch.setenv("PATH", "")
    assert "apt install" in missing()
    with pytest.raises(DeviceError, match="avr-gcc"):
        build()
