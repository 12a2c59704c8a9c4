"""An NV200/D plays tables by its waveform generator and records by its data recorder."""

from collections.abc import Callable

import numpy as np
import pytest
from pydantic import ValidationError

from piezod.devices.player import AtEnd, PlayState, Table
from piezod.errors import DeviceError
from piezod_drivers.serial_line.psj.options import PsjOptions
from piezod_drivers.serial_line.psj.wave_requests import CLOCK_NS
from tests.drivers.play_bench import played
from tests.drivers.serial_line.nv200_play_bench import Nv200Bench, play_bench, sine
from tests.drivers.serial_line.scripted_line import MS

HELD = 400
"""Points of the first value, at 50 µs."""
SLOW = sine(50, n_lead_in=10)._replace(interval_ns=400_000)
"""A table of 60 points, at 0.4 ms."""


def changed(begin: bytes, to: bytes) -> Callable[[bytes], bytes]:
    """Return a change of the replies that begin so."""
    return lambda reply: to if reply.startswith(begin) else reply


@pytest.mark.parametrize("table", [sine(), sine(n_lead_in=0), SLOW], ids=["fast", "bare", "slow"])
def test_plays_and_records(table: Table) -> None:
    """The first value is held, then every point comes in order; a position precedes its point."""
    bench = play_bench(wave_end="holds")
    assert bench.device.write([table.lead_in[0, 0] if len(table.lead_in) else 60.0], 0)
    bench.rig.driven_v.clear()
    loaded = bench.start(table)
    assert bench.progress_to_end() == (PlayState.ENDED, 3, "")
    record, points = bench.device.recording(), played(loaded)
    driven_v = [v for (v,) in bench.rig.driven_v]
    n_held = len(driven_v) - len(points) - 1
    assert 0 < n_held <= HELD
    assert driven_v[:n_held] == pytest.approx([points[0, 0]] * n_held, abs=1e-3)
    assert driven_v[n_held:-1] == pytest.approx(points[:, 0], abs=1e-3)
    assert driven_v[-1] == pytest.approx(points[-1, 0], abs=1e-3)
    assert record.positions[1:, 0] == pytest.approx(points[:-1, 0] * 0.2, abs=1e-3)
    assert record.outputs == pytest.approx(points, abs=1e-3)
    assert (record.interval_ns, record.first_point) == (table.interval_ns, 0)
    assert len(record.positions) == len(points)


def test_capabilities() -> None:
    """A point every 50 µs or a multiple, 1024 with the held ones; the end is unknown by default."""
    able = play_bench().device.player_capabilities()
    assert (able.shortest_interval_ns, able.interval_step_ns) == (CLOCK_NS, CLOCK_NS)
    assert (able.points, able.record_points, able.cycles) == (1023, 6144, 65_535)
    assert (able.at_end, able.replaces) == (AtEnd.UNKNOWN, False)
    assert play_bench(wave_end="holds").device.player_capabilities().at_end is AtEnd.HOLDS


def test_other_models_do_not_play() -> None:
    """Only an NV200/D has a waveform generator that piezod knows."""
    with pytest.raises(ValidationError, match="not for ddrive, which plays no tables"):
        PsjOptions(profile="ddrive", port="p", wave_end="holds")


def test_the_generator_becomes_the_source_while_the_first_value_is_held() -> None:
    """It runs before it drives, and the command drives again after its end, without a jump."""
    bench = play_bench(wave_end="holds")
    bench.device.load(sine())
    bench.device.arm()
    bench.line.sent.clear()
    bench.device.start(bench.time.t_ns)
    assert bench.line.sent == [b"grun,1\r", b"grun\r", b"modsrc,3\r"]
    assert bench.waveforms.index < HELD
    bench.line.sent.clear()
    bench.progress_to_end()
    assert bench.line.sent[-3:-1] == [b"set,58.116\r", b"set\r"]
    assert bench.line.sent[-1] == b"modsrc,0\r"


def test_a_generator_that_does_not_run_moves_nothing() -> None:
    """Then it does not become the source."""
    bench = play_bench()
    bench.device.write([30.0], bench.time.t_ns)
    bench.device.load(sine())
    bench.device.arm()
    bench.line.change = changed(b"\x13grun,", b"\x13grun,0\r\n\x11")
    with pytest.raises(DeviceError, match="does not start"):
        bench.device.start(bench.time.t_ns)
    assert bench.rig.drive_v == [30.0]
    assert list(bench.device.abort(bench.time.t_ns)) == [30.0]
    assert bench.device.write([31.0], bench.time.t_ns)


@pytest.mark.parametrize("drops", [False, True])
def test_abort_returns_the_measured_voltage(drops: bool) -> None:
    """Wherever the output goes when the generator stops, its voltage becomes the setpoint."""
    bench = play_bench(drops=drops)
    bench.start(sine(cycles=100))
    bench.wait(40 * MS)
    (value_v,) = bench.device.abort(bench.time.t_ns)
    assert value_v == pytest.approx(bench.rig.drive_v[0], abs=1e-3)
    assert (value_v == 0.0) is drops
    assert bench.waveforms.source == 0
    assert list(bench.device.read_back(bench.time.t_ns)) == [value_v]


def test_a_setpoint_that_is_not_stored_leaves_the_generator_the_source() -> None:
    """Else the output would jump to another setpoint; the voltage is unknown, and not driven."""
    bench = play_bench()
    bench.start(sine(cycles=100))
    bench.wait(40 * MS)
    bench.line.change = changed(b"\x13set,", b"\x13set,7.000\r\n\x11")
    assert np.isnan(bench.device.abort(bench.time.t_ns)).all()
    assert "the waveform stays its source" in bench.device.last_fault
    assert bench.waveforms.source == 3
    assert not bench.device.write([0.0], bench.time.t_ns)


def test_a_wrong_digit_of_the_measured_voltage_is_seen() -> None:
    """Two samples must agree; the voltage is found by the next stop."""
    bench = play_bench()
    bench.start(sine(cycles=100))
    bench.wait(40 * MS)
    bench.line.change = changed(b"\x13recout,1,0,", b"\x13recout,1,0,7.000\r\n\x11")
    assert np.isnan(bench.device.abort(bench.time.t_ns)).all()
    assert "the measured voltage is 7 V, then" in bench.device.last_fault
    bench.line.change = lambda reply: reply
    (value_v,) = bench.device.abort(bench.time.t_ns)
    assert value_v == pytest.approx(bench.rig.drive_v[0], abs=1e-3)


def test_a_play_in_the_device_s_own_loop_is_refused() -> None:
    """There a waveform is one of positions."""
    bench = play_bench()
    bench.amplifier.receive(b"cl,1\r")
    with pytest.raises(DeviceError, match="own loop is closed"):
        bench.device.load(sine())


def test_cycles_are_counted_while_the_generator_moves_on() -> None:
    """The clock of the computer counts them; a generator that stands still completes none."""
    bench = play_bench()
    bench.start(sine(cycles=60_000)._replace(interval_ns=10 * CLOCK_NS))
    bench.device.progress(bench.time.t_ns)
    bench.wait(10_000 * MS)
    cycle = bench.device.progress(bench.time.t_ns).cycle
    assert cycle == (10_000 - 30) // 50
    bench.line.change = changed(b"\x13giarb", b"\x13giarb,7\r\n\x11")
    still_ns = bench.time.t_ns
    for _ in range(60):
        bench.wait(200 * MS)
        found = bench.device.progress(bench.time.t_ns)
        if found.state is PlayState.FAILED:
            break
    assert found == (PlayState.FAILED, found.cycle, "the play does not go on")
    assert bench.time.t_ns - still_ns > 10_000 * MS


def test_progress_is_two_exchanges_or_none() -> None:
    """The device is asked ten times a second."""
    bench = play_bench()
    bench.start(sine(cycles=1000))
    asked = []
    for _ in range(30):
        bench.wait(10 * MS)
        bench.line.sent.clear()
        bench.device.progress(bench.time.t_ns)
        asked.append(len(bench.line.sent))
    assert set(asked) == {0, 2}
    assert 5 < sum(asked) < 10


def test_loaded_table_is_the_one_that_the_device_holds() -> None:
    """The waveform is read back; a device that holds another value refuses it."""
    bench = play_bench()
    bench.line.change = changed(b"\x13gbarb,450,", b"\x13gbarb,450,7.000\r\n\x11")
    with pytest.raises(DeviceError, match=r"holds 7 % at point 450 instead of 59\.021 %"):
        bench.device.load(sine())
    with pytest.raises(DeviceError, match="cannot arm: it is idle"):
        bench.device.arm()


def ended() -> Nv200Bench:
    """Return a bench whose play has ended."""
    bench = play_bench(wave_end="holds")
    bench.start(sine())
    assert bench.progress_to_end().state is PlayState.ENDED
    return bench


def test_a_cut_record_is_refused() -> None:
    """There must be a sample for each point."""
    bench = ended()
    del bench.waveforms.rows[500:]
    with pytest.raises(DeviceError, match="the record has 500 points, expected 720"):
        bench.device.recording()


def test_a_record_of_other_voltages_is_refused() -> None:
    """If the recorder shows other voltages, the unit of the waveform is another one."""
    bench = ended()
    bench.waveforms.rows = [(position, 0.1 * drive_v) for position, drive_v in bench.waveforms.rows]
    with pytest.raises(DeviceError, match="the unit of its waves may be another one"):
        bench.device.recording()


def test_a_record_of_another_scale_is_refused() -> None:
    """It must begin at the position that the device reported before."""
    bench = ended()
    bench.waveforms.rows = [(position + 9, drive_v) for position, drive_v in bench.waveforms.rows]
    with pytest.raises(DeviceError, match="begins at 9 µm, the device reported 0 µm before"):
        bench.device.recording()


@pytest.mark.parametrize(
    ("table", "what"),
    [
        (sine(700), r"has 720 points, allowed at an interval of 50 µs: at most 624, because"),
        (sine()._replace(interval_ns=75_000), "the interval of a table is 75000 ns"),
        (sine()._replace(period=np.full((5, 1), 151.0)), r"is 151, allowed range 0 to 150"),
        (sine(cycles=65_536), "a table has 65536 cycles, allowed: 1 to 65535"),
    ],
)
def test_an_impossible_table_is_refused(table: Table, what: str) -> None:
    """The message names value and allowed range, and no point is written."""
    bench = play_bench()
    with pytest.raises(DeviceError, match=what):
        bench.device.load(table)
    assert not any(b"gbarb" in sent for sent in bench.line.sent)
