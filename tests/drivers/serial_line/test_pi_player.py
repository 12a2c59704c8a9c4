"""A PI controller plays tables by its wave generators and records by its data recorder."""

import numpy as np
import pytest

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.player import AtEnd, Comparison, PlayState, Table
from piezod.errors import DeviceError
from piezod_drivers.serial_line.pi_gcs2.driver import make_device
from tests.drivers.play_bench import played
from tests.drivers.serial_line.pi_gcs2_bench import OPTIONS
from tests.drivers.serial_line.pi_play_bench import play_bench, sine
from tests.drivers.serial_line.scripted_line import MS


@pytest.mark.parametrize("n_lead_in", [0, 20])
def test_plays_and_records(n_lead_in: int) -> None:
    """Every point comes to the output in order; a position precedes its point."""
    bench = play_bench()
    loaded = bench.start(sine(n_lead_in=n_lead_in))
    assert bench.progress_to_end() == (PlayState.ENDED, 3, "")
    record, points = bench.device.recording(), played(loaded)
    assert [v for (v,) in bench.rig.driven_v] == pytest.approx(points[:, 0], abs=1e-6)
    assert record.positions[1:] == pytest.approx(points[:-1] * 0.2, abs=1e-5)
    assert record.outputs == pytest.approx(points, abs=1e-5)
    assert (record.interval_ns, record.first_point) == (50_000, 0)


def test_lead_in_is_written_out() -> None:
    """Without a lead-in the generator repeats the period; with one, it plays everything once."""
    bench = play_bench()
    bench.start(sine(n_lead_in=0))
    assert b"WAV 1 & PNT 81 20 " in b"".join(bench.line.sent)
    assert b"WGC 1 3\n" in b"".join(bench.line.sent)
    bench.progress_to_end()
    bench.line.sent.clear()
    bench.start(sine())
    assert b"WAV 1 & PNT 301 20 " in b"".join(bench.line.sent)
    assert b"WGC 1 1\n" in b"".join(bench.line.sent)


def test_loaded_table_is_the_one_that_the_controller_holds() -> None:
    """The table is read back; a controller that holds another value refuses it."""
    bench = play_bench()
    table = sine()._replace(period=sine().period + 1.23e-5)
    loaded = bench.device.load(table)
    assert loaded.period == pytest.approx(np.round(table.period, 4), abs=1e-9)
    bench.line.change = lambda reply: reply.replace(b"\n60.000000 \n", b"\n61.000000 \n", 1)
    with pytest.raises(DeviceError, match=r"wave 1 holds 61 at point \d+ instead of 60\.0000"):
        bench.device.load(sine(n_lead_in=20))
    with pytest.raises(DeviceError, match="cannot arm: it is idle"):
        bench.device.arm()


def test_two_axes_are_played_in_step() -> None:
    """One command starts both generators, and each axis gets its own column."""
    bench = play_bench(2)
    loaded = bench.start(sine(n_outputs=2))
    assert bench.line.sent[-1] == b"WGO 1 1 2 1\nERR?\n"
    bench.progress_to_end()
    record = bench.device.recording()
    assert record.outputs == pytest.approx(played(loaded), abs=1e-5)
    assert record.positions[1:] == pytest.approx(played(loaded)[:-1] * 0.2, abs=1e-5)


def test_stop_ends_the_comparison() -> None:
    """A line that pulses at positions does not go on while the loop moves the axis."""
    bench = play_bench(trigger_outputs=3)
    bench.start(sine()._replace(compared=Comparison(3, 0, 2.0, 9.0, 0.5)))
    bench.line.sent.clear()
    bench.device.abort(bench.time.t_ns)
    bench.device.progress(bench.time.t_ns)

    assert b"CTO 3 3 4\n" in b"".join(bench.line.sent)


def test_capabilities_are_asked() -> None:
    """Servo time and sizes come from the controller."""
    able = play_bench().device.player_capabilities()
    assert (able.shortest_interval_ns, able.interval_step_ns) == (50_000, 50_000)
    # The recorder has as many tables as there are channels: a position and a voltage.
    assert (able.points, able.points_shared, able.record_points) == (262_144, True, 131_072)
    assert (able.at_end, able.replaces) == (AtEnd.UNKNOWN, False)
    assert play_bench(wave_end="holds").device.player_capabilities().at_end is AtEnd.HOLDS


def test_a_recorder_with_fixed_tables_is_taken_as_it_is() -> None:
    """A controller that refuses another number of tables has shorter ones."""
    bench = play_bench()
    del bench.controller._handlers["SPA"]  # noqa: SLF001 - another controller
    assert bench.device.player_capabilities().record_points == 32_768


def test_slower_points_are_recorded_at_their_own_rate() -> None:
    """With an interval of several servo cycles there is one sample for each point."""
    bench = play_bench()
    loaded = bench.start(sine()._replace(interval_ns=200_000))
    bench.progress_to_end()
    record = bench.device.recording()
    assert record.interval_ns == 200_000
    assert record.outputs == pytest.approx(played(loaded), abs=1e-5)


def test_writes_are_refused_while_playing() -> None:
    """Until the end every setpoint is refused; positions and voltages are still read."""
    bench = play_bench()
    bench.start(sine())
    bench.wait(5 * MS)
    assert not bench.device.write([1.0], bench.time.t_ns)
    assert isinstance(bench.device, ExchangingBusDevice)
    taken, (sample,) = bench.device.exchange([1.0], bench.time.t_ns)
    assert not taken
    assert sample.valid
    assert not any(b"SVA" in sent for sent in bench.line.sent)
    bench.progress_to_end()
    assert bench.device.write([1.0], bench.time.t_ns)


def test_a_second_play_begins_at_its_first_point() -> None:
    """An offset that somebody's start at the end has moved is taken back."""
    bench = play_bench()
    bench.controller.receive(b"WAV 1 X PNT 1 2 0 5\nWSL 1 1\nWGC 1 3\nWGO 1 0x101\n")
    bench.wait(500 * MS)
    assert bench.controller.receive(b"WOS? 1\n") == [b"1=15.0\n"]
    bench.rig.driven_v.clear()
    loaded = bench.start(sine())
    bench.progress_to_end()
    assert [v for (v,) in bench.rig.driven_v] == pytest.approx(played(loaded)[:, 0], abs=1e-6)


def test_progress_is_one_exchange_or_none() -> None:
    """The controller is asked ten times a second."""
    bench = play_bench()
    bench.start(sine(cycles=400, n_lead_in=0))
    bench.device.progress(bench.time.t_ns)
    asked, cycles = [], set()
    for _ in range(40):
        bench.wait(10 * MS)
        bench.line.sent.clear()
        cycles.add(bench.device.progress(bench.time.t_ns).cycle)
        asked.append(len(bench.line.sent))
    assert max(asked) == 1
    assert 3 <= sum(asked) <= 4
    assert max(cycles) > 50


def test_cycles_are_counted_behind_a_lead_in() -> None:
    """The point of the generator gives the cycle."""
    bench = play_bench()
    bench.start(sine(cycles=100))
    bench.wait(20 * 50_000 + 42 * 100 * 50_000)
    assert bench.device.progress(bench.time.t_ns) == (PlayState.PLAYING, 42, "")


def test_without_a_measured_voltage_a_found_play_leaves_it_unknown() -> None:
    """SVA? returns an old setpoint, so the controller is not taken over, but it is stopped."""
    bench = play_bench()
    bench.start(sine(cycles=500))
    bench.wait(8 * MS)
    other = make_device(
        bench.line, OPTIONS.model_copy(update={"read_back": "SVA?"}), Wiring((), ("1",))
    )
    other.open()
    with pytest.raises(DeviceError, match=r"SVA[?] does not measure its voltage"):
        other.activate(bench.time.t_ns)
    held_v = list(bench.rig.drive_v)
    bench.wait(30 * MS)
    assert bench.rig.drive_v == held_v


def test_playing_needs_a_measured_voltage() -> None:
    """With SVA? the voltage at a stop would be unknown."""
    bench = play_bench(read_back="SVA?")
    with pytest.raises(DeviceError, match=r"playing needs read_back: VOL[?]"):
        bench.device.player_capabilities()


def test_a_controller_without_generators_cannot_play() -> None:
    """An unknown command means that there is no wave generator; everything else works."""
    bench = play_bench()
    for command in ("WGO", "WGO?"):
        del bench.controller._handlers[command]  # noqa: SLF001 - another controller
    with pytest.raises(DeviceError, match="has no wave generator"):
        bench.device.player_capabilities()
    other = bench.connect(Wiring((), ("1",)))
    other.open()
    other.activate(bench.time.t_ns)
    assert other.write([5.0], bench.time.t_ns)


def test_other_voltages_than_those_of_the_table_are_refused() -> None:
    """If the recorder shows other voltages, the unit of the waves is another one."""
    bench = play_bench()
    bench.start(sine())
    bench.progress_to_end()
    bench.controller._waves.recorder._rows = [  # noqa: SLF001 - another unit
        [position, 3 * drive_v, *others]
        for position, drive_v, *others in bench.controller._waves.recorder._rows  # noqa: SLF001
    ]
    with pytest.raises(DeviceError, match=r"differs from the table by \d+.*: 34; the unit"):
        bench.device.recording()


@pytest.mark.parametrize(
    ("table", "what"),
    [
        (sine(cycles=3000), "lead-in and 3000 cycles are a wave of 300020 points"),
        (sine()._replace(interval_ns=75_000), "the interval of a table is 75000 ns"),
        (sine()._replace(period=np.full((5, 1), 151.0)), "is 151, allowed range -20 to 150"),
    ],
)
def test_an_impossible_table_is_refused(table: Table, what: str) -> None:
    """The message names value and allowed range, and no wave is written."""
    bench = play_bench()
    with pytest.raises(DeviceError, match=what):
        bench.device.load(table)
    assert not any(b"WAV" in sent for sent in bench.line.sent)


def test_a_running_generator_of_another_program_is_reported() -> None:
    """A table is not loaded while a generator runs."""
    bench = play_bench()
    bench.controller.receive(b"WAV 1 X PNT 1 2 0 5\nWSL 1 1\nWGO 1 1\n")
    with pytest.raises(DeviceError, match="a wave generator is running"):
        bench.device.load(sine())
