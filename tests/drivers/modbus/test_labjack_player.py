"""A LabJack plays tables by its stream-outs and records its inputs by its stream."""

import numpy as np
import pytest

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod.devices.interface import Wiring
from piezod.devices.player import AtEnd, PlayState, Table
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.modbus import emulator
from piezod_drivers.modbus.profiles.labjack_stream import (
    ENABLE,
    OUT_ENABLE,
    OUT_VALUES,
    SCAN_RATE_HZ,
)
from tests.drivers.modbus.play_bench import ONE, LabJackBench, play_bench, sine
from tests.drivers.play_bench import played
from tests.drivers.serial_line.scripted_line import MS

TWO = Wiring(("AIN1", "AIN0"), ("DAC1", "DAC0"))
MOST_BETWEEN_CODES_V = 4e-4
"""Distance of two codes of an input in its largest range, and a little more."""
SENSOR_PER_OUTPUT = 150 / 5 * 0.2 / 5
"""An output of 5 V drives 150 V, which move the rig by 0.2 µm/V; its sensor gives 1 V for 5 µm."""


def written(bench: LabJackBench) -> list[int]:
    """Return the registers that function 16 wrote, in order, without repetitions."""
    addresses = [int.from_bytes(f[8:10], "big") for f in bench.line.sent if f[7] == 16]
    return [a for i, a in enumerate(addresses) if not i or addresses[i - 1] != a]


@pytest.mark.parametrize(
    ("plugin", "highest_v", "most_v"),
    [
        (emulator.LABJACK_T4, 5.0, 2e-3),
        (emulator.LABJACK_T7, 5.0, MOST_BETWEEN_CODES_V),
        (emulator.LABJACK_T8, 10.0, MOST_BETWEEN_CODES_V),
    ],
)
def test_plays_and_records(plugin: EmulatorPlugin, highest_v: float, most_v: float) -> None:
    """Every point comes to the output in order, and each sample precedes the point of its scan."""
    bench = play_bench(plugin)
    loaded = bench.start(sine())
    bench.rig.driven_v.clear()
    assert bench.progress_to_end() == (PlayState.ENDED, 3, "")
    record = bench.device.recording()

    points = played(loaded)
    assert [v for (v,) in bench.rig.driven_v] == pytest.approx(points[:, 0] * 150 / highest_v)
    expected = np.concatenate(([0.0], points[:-1, 0])) * SENSOR_PER_OUTPUT * 5 / highest_v
    assert record.positions[:, 0] == pytest.approx(expected, abs=most_v)
    assert (record.interval_ns, record.first_point, record.outputs.shape) == (50_000, 0, (320, 0))


def test_two_outputs_are_played_in_step() -> None:
    """Each output gets its own column, in any order of the channels."""
    bench = play_bench(wiring=TWO)
    loaded = bench.start(sine(n_outputs=2))
    bench.progress_to_end()
    record = bench.device.recording()
    points = played(loaded)
    assert record.positions[1:] == pytest.approx(points[:-1] * SENSOR_PER_OUTPUT, abs=1e-3)
    # The rig is written once for each output of a scan: axis 1 is DAC1, the first column.
    assert bench.rig.driven_v[-1] == pytest.approx(points[-1, ::-1] * 30)


def test_capabilities() -> None:
    """The shortest interval covers every channel of the scan; a T7 has steps of 12 bits."""
    able = play_bench(wiring=TWO).device.player_capabilities()
    assert (able.shortest_interval_ns, able.interval_step_ns) == (40_000, 100)
    assert (able.points, able.points_shared, able.replaces) == (8191, False, False)
    assert able.resolution == (5 / 4095, 5 / 4095)
    assert (able.at_end, able.watchdog_while_playing) == (AtEnd.HOLDS, False)
    assert able.lag_ns == 20_000
    assert play_bench().device.player_capabilities().shortest_interval_ns == 20_000


def test_registers_are_written_in_order() -> None:
    """A stream-out is reset and enabled before its values; the stream is enabled last."""
    bench = play_bench()
    bench.line.sent.clear()
    bench.start(sine())
    order = written(bench)
    assert order[:4] == [OUT_ENABLE, 4040, 4050, OUT_ENABLE]
    assert order.index(OUT_VALUES) < order.index(4070) < order.index(SCAN_RATE_HZ)
    assert order[-1] == ENABLE


def test_a_full_buffer_is_played() -> None:
    """A table of 8191 points fits; one point more does not."""
    bench = play_bench()
    bench.start(sine(8171, cycles=1))
    assert bench.progress_to_end().state is PlayState.ENDED
    assert len(bench.device.recording().positions) == 8191
    with pytest.raises(DeviceError, match=r"a table has 8192 points, allowed: at most 8191"):
        bench.device.load(sine(8172))


def test_writes_are_refused_while_playing() -> None:
    """Until the end every setpoint is refused, and the samples come from the stream."""
    bench = play_bench()
    bench.start(sine())
    bench.wait(5 * MS)
    assert not bench.device.write([1.0], bench.time.t_ns)
    assert isinstance(bench.device, ExchangingBusDevice)
    taken, _ = bench.device.exchange([1.0], bench.time.t_ns)
    assert not taken
    bench.wait(5 * MS)
    bench.device.progress(bench.time.t_ns)
    (sample,) = bench.device.read(bench.time.t_ns)
    assert sample.valid
    assert sample.position_um == pytest.approx(bench.rig.drive_v[0] * 0.04, abs=0.15)
    bench.progress_to_end()
    assert bench.device.write([1.0], bench.time.t_ns)
    assert bench.device.read(bench.time.t_ns)[0].valid
    assert DeviceFlag.LOCAL_MODE not in frozenset().union(*bench.device.status(bench.time.t_ns))


def test_abort_after_the_end_tells_the_last_voltage() -> None:
    """A play that has ended unnoticed is stopped without an error."""
    bench = play_bench()
    loaded = bench.start(sine())
    bench.wait(500 * MS)
    (value_v,) = bench.device.abort(bench.time.t_ns)
    assert value_v == pytest.approx(loaded.period[-1, 0])


def test_progress_is_one_exchange_or_none() -> None:
    """Packets are taken without a request; the device is asked ten times a second."""
    bench = play_bench()
    bench.start(sine(cycles=60))
    bench.device.progress(bench.time.t_ns)
    asked = []
    for _ in range(26):
        bench.wait(8 * MS)
        bench.line.sent.clear()
        bench.device.progress(bench.time.t_ns)
        asked.append(len(bench.line.sent))
    assert max(asked) == 1
    assert sum(asked) == 2


def test_the_watchdog_is_fed_while_playing() -> None:
    """A play that is longer than the watchdog's time-out does not trip it."""
    bench = play_bench(watchdog={"timeout_s": 1.0, "safe": 0.5})
    bench.start(sine(100, cycles=250))
    assert bench.progress_to_end().state is PlayState.ENDED
    assert not any(14.9 < drive_v < 15.1 for (drive_v,) in bench.rig.driven_v)  # safe is 15 V
    assert bench.device.write([2.0], bench.time.t_ns)
    assert frozenset().union(*bench.device.status(bench.time.t_ns)) == frozenset()


def test_a_watchdog_that_tripped_during_a_play_fails_it() -> None:
    """If the host stalls until the end, the outputs are safe, and no write may follow."""
    bench = play_bench(watchdog={"timeout_s": 1.0, "safe": 0.5})
    bench.start(sine())
    bench.wait(3000 * MS)
    found = bench.progress_to_end()
    assert found.state is PlayState.FAILED
    assert "not at the table's end" in found.reason
    assert not bench.device.write([2.0], bench.time.t_ns)
    assert list(bench.device.abort(bench.time.t_ns)) == pytest.approx([0.5], abs=1e-3)
    assert bench.rig.drive_v == pytest.approx([15.0], abs=0.05)


def test_lost_scans_are_nan() -> None:
    """Scans that the device could not store are NaN, all later samples are at their own time."""
    bench = play_bench()
    loaded = bench.start(sine(100, cycles=250))
    bench.stream.room = 4000
    for _ in range(100):  # 1 s, in which 20000 samples do not fit into 16384
        bench.wait(10 * MS)
        assert bench.device.progress(bench.time.t_ns).state is PlayState.PLAYING
    bench.stream.room = None
    assert bench.progress_to_end().state is PlayState.ENDED
    positions = bench.device.recording().positions[:, 0]
    expected = np.concatenate(([0.0], played(loaded)[:-1, 0])) * SENSOR_PER_OUTPUT
    lost = np.isnan(positions)
    assert 1000 < lost.sum() < 20_000
    assert not lost[-1000:].any()
    assert positions[~lost] == pytest.approx(expected[~lost], abs=1e-3)


def test_a_lost_stream_fails_the_play() -> None:
    """Without the packets there is no record; the device plays on until it is stopped."""
    bench = play_bench()
    bench.start(sine(cycles=50))
    bench.wait(8 * MS)
    bench.stream.unplugged = True
    found = bench.device.progress(bench.time.t_ns)
    assert found.state is PlayState.FAILED
    assert "the stream is lost" in found.reason
    assert not bench.device.write([1.0], bench.time.t_ns)
    (value_v,) = bench.device.abort(bench.time.t_ns)
    assert value_v * 30 == pytest.approx(bench.rig.drive_v[0], abs=1e-4)


def test_a_finished_play_of_a_dead_host_has_held() -> None:
    """The device ends its cycles by itself and holds the last point."""
    bench = play_bench()
    loaded = bench.start(sine())
    bench.wait(500 * MS)
    assert bench.rig.drive_v == pytest.approx(loaded.period[-1] * 30)
    other = bench.connect(ONE)
    other.open()
    other.activate(bench.time.t_ns)
    assert list(other.read_back(bench.time.t_ns)) == pytest.approx(loaded.period[-1], abs=1e-4)


def test_a_foreign_stream_of_inputs_is_left_alone() -> None:
    """A stream that drives none of our outputs is not stopped; with inputs, it is reported."""
    bench = play_bench()
    bench.start(sine(cycles=500))
    other = bench.connect(Wiring(("AIN0",), ("DAC1",)))
    other.open()
    with pytest.raises(DeviceError, match="a stream of another program is running"):
        other.activate(bench.time.t_ns)
    other.close()
    bench.line.open()
    only_output = bench.connect(Wiring((), ("DAC1",)))
    only_output.open()
    only_output.activate(bench.time.t_ns)
    with pytest.raises(DeviceError, match="a stream of another program is running"):
        only_output.load(sine())
    moving_v = list(bench.rig.drive_v)
    bench.wait(11 * MS)
    assert bench.rig.drive_v != moving_v


@pytest.mark.parametrize(
    ("table", "what"),
    [
        (sine()._replace(interval_ns=50_050), "the interval of a table is 50050 ns"),
        (sine()._replace(interval_ns=19_900), "allowed: 20000 to 6553600 ns"),
        (sine()._replace(cycles=0), "a table has 0 cycles"),
        (sine()._replace(period=np.full((5, 1), 5.1)), r"point 0 of period of output 0 is 5\.1"),
        (sine()._replace(lead_in=np.full((5, 1), np.nan)), "point 0 of lead_in of output 0 is nan"),
        (sine()._replace(period=np.empty((0, 1))), "the period of a table has no point"),
        (sine(n_outputs=2), "lead_in has the shape"),
    ],
)
def test_an_impossible_table_is_refused(table: Table, what: str) -> None:
    """The message names value and allowed range, and nothing is sent."""
    bench = play_bench()
    bench.device.player_capabilities()
    bench.line.sent.clear()
    with pytest.raises(DeviceError, match=what):
        bench.device.load(table)
    assert bench.line.sent == []
    with pytest.raises(DeviceError, match="cannot arm: it is idle"):
        bench.device.arm()


def test_an_error_of_the_device_is_named() -> None:
    """A refused register is reported with the device's own error."""
    bench = play_bench()
    setup = bench.device._play.setup  # type: ignore[attr-defined]  # noqa: SLF001 - the registers
    with pytest.raises(DeviceError, match=r"register 4060: error 2627, a stream-out must be enabl"):
        setup.write(4060, 5)
    assert not bench.device.lost


def test_samples_of_another_scale_fail_the_play() -> None:
    """If the first sample is far from the input before the start, the scale is not trusted."""
    bench = play_bench()
    bench.rig.at_um[0] = 20.0
    bench.device.load(sine())
    bench.device.arm()
    bench.rig.at_um[0] = 10.0
    bench.device.start(bench.time.t_ns)
    assert "the samples have another scale" in bench.progress_to_end().reason


SLOW = sine(cycles=40)._replace(interval_ns=6_500_000)
"""A cycle of 0.65 s."""


def test_a_slow_clock_is_no_failure() -> None:
    """A play may take longer than expected by any time, if it goes on."""
    bench = play_bench()
    bench.start(SLOW)
    started_ns = bench.time.t_ns
    for _ in range(300):
        bench.wait(100 * MS)
        progress = bench.device.progress(started_ns + 2 * (bench.time.t_ns - started_ns))
        if progress.state is not PlayState.PLAYING:
            break
    assert progress == (PlayState.ENDED, 40, "")


def test_a_play_that_stands_still_has_failed() -> None:
    """The next cycle must be complete in its time and 10 s."""
    bench = play_bench()
    bench.start(SLOW)
    for _ in range(70):
        bench.wait(100 * MS)
        bench.device.progress(bench.time.t_ns)
    still_ns = bench.time.t_ns
    assert bench.device.progress(still_ns + 9_000 * MS).state is PlayState.PLAYING
    failed = bench.device.progress(still_ns + 11_000 * MS)
    assert failed == (PlayState.FAILED, failed.cycle, "the play does not go on")
    assert not bench.device.write([0.0], still_ns)
