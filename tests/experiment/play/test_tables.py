"""Tables from a wanted displacement, and periodic commands."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.fields import Context
from piezod.config.play import WaveConfig
from piezod.control.guard import Limits
from piezod.control.table_guard import TableGuard
from piezod.devices.player import AtEnd
from piezod.errors import DataError, DeviceError
from piezod.experiment.play.command import (
    PeriodicCommand,
    command_of,
    legal_interval_ns,
    points_of,
)
from piezod.experiment.play.tables import TableMaker
from piezod.experiment.play.task import static_gain
from piezod.hysteresis import SurfaceForm
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.path_relaxation import PathRelaxation
from tests.control.made_up import RELAXING
from tests.experiment.play.rig_axis import INTERVAL_NS, LIMITS, RigAxis, maker, model, sine


def wave(**command_um: object) -> WaveConfig:
    """Return a configured waveform."""
    data = {"name": "wave", "command_um": command_um}
    return WaveConfig.model_validate(data, context=Context())


@given(st.floats(10.0, 400.0), st.floats(2.0, 12.0), st.floats(14.0, 29.0), st.floats(0.0, 150.0))
def test_every_table_of_the_maker_passes_the_guard(
    frequency_hz: float, low_um: float, high_um: float, in_force_v: float
) -> None:
    """From any voltage in force, lead-in, period and wrap are within range and slew rate."""
    n = round(1e9 / frequency_hz / INTERVAL_NS)
    command = sine(1e9 / (n * INTERVAL_NS), low_um, high_um)
    table = maker().table(command.values_um, in_force_v, 5)

    TableGuard(LIMITS, 0.0, AtEnd.HOLDS, 10).check(table, in_force_v)
    assert table.cycles == 5
    assert table.period_v.size == n


def test_lead_in_of_a_slow_axis_keeps_its_slew_rate() -> None:
    """The conditioning swing takes as long as the limit requires."""
    slow = Limits(0.0, 150.0, 400.0)
    command = sine(1.0)
    table = maker(slow).table(command.values_um, 0.0, 2)

    TableGuard(slow, 0.0, AtEnd.HOLDS, 10).check(table, 0.0)
    assert table.lead_in_v.size > 20_000


def test_period_is_that_of_the_hysteresis_after_many_periods() -> None:
    """Driven by the table, the model repeats the wanted displacement from the first period on."""
    command = sine(50.0)
    table = maker().table(command.values_um, 0.0, 2)
    known = model()
    form = known.form.sampled(INTERVAL_NS * 1e-9)
    drives_v = np.concatenate((table.lead_in_v, np.tile(table.period_v, 3)))
    positions = form.positions_at(known.weights, known.drive_v.to_unit(drives_v))
    n = command.values_um.size

    for number in range(3):
        begin = table.lead_in_v.size + number * n
        period_um = known.position_um.from_unit(positions[begin : begin + n])
        assert period_um == pytest.approx(command.values_um, abs=2e-3)


def test_same_play_after_different_pasts() -> None:
    """The conditioning swing leaves the same memory: the displacement repeats to 0.1 %."""
    command = sine(100.0)
    table = maker().table(command.values_um, 0.0, 20)
    last = []
    for before in (sine(200.0, 10.0, 28.0), sine(50.0, 0.5, 15.0)):
        axis = RigAxis()
        axis.play(maker().table(before.values_um, axis.rest().drive_v, 20))
        axis.rest()
        true_um = axis.play(table).true_um
        last.append(true_um[-command.values_um.size :])

    assert np.ptp(last[0] - last[1]) < 1e-3 * command.swing_um


def test_displacement_beyond_the_model_is_refused() -> None:
    """The text names the farthest point, its value, and the range."""
    values_um = sine().values_um.copy()
    values_um[17] = 40.0

    with pytest.raises(DataError, match=r"40 µm at point 17 of the period, .* to 31\.\d+ µm, all"):
        maker().table(values_um, 0.0, 1)
    with pytest.raises(DataError, match=r"the command is 40 µm at point 17 .* to 31\.\d+ µm; re"):
        maker().check(values_um)
    values_um[17] = np.nan
    with pytest.raises(DataError, match="point 17"):
        maker().table(values_um, 0.0, 1)


def test_correction_may_leave_the_model_by_a_little() -> None:
    """There the voltage is that of the end of the model; a command may not leave it at all."""
    wanted_um = sine(200.0, -1.5, 24.0).values_um
    table = maker().table(wanted_um, 0.0, 1)

    assert table.period_v[wanted_um <= 0.0] == pytest.approx(0.0, abs=1e-3)
    with pytest.raises(DataError, match="model holds from 0"):
        maker().check(wanted_um)


def test_command_of_a_sine_begins_at_its_lowest_value() -> None:
    """A period has the points from its beginning to just before the next one."""
    command = command_of(wave(kind="sine", low=2.0, high=12.0, frequency_hz=200.0), INTERVAL_NS)

    assert command.values_um.size == 100
    assert command.values_um[[0, 50]] == pytest.approx([2.0, 12.0])
    assert command.swing_um == pytest.approx(10.0)
    assert command.period_s == pytest.approx(5e-3)
    assert command.harmonics_hz[1] == pytest.approx(200.0)
    assert command.cycles(0.0251, 4) == 6
    assert command.cycles(0.0, 4) == 4


def test_command_of_points_is_one_period() -> None:
    """The last point is the first one again, at any time."""
    points = ((0.5, 1.0), (0.502, 5.0), (0.505, 1.0))
    command = command_of(wave(kind="points", points=points), INTERVAL_NS)

    assert command.values_um.size == 100
    assert command.values_um[[0, 20, 40]] == pytest.approx([1.0, 3.0, 5.0])


@pytest.mark.parametrize(
    ("command_um", "text"),
    [
        ({"kind": "points", "points": ((0.0, 1.0), (0.1, 2.0))}, "ends at 2 µm.*close the period"),
        ({"kind": "points", "points": ((0.0, 1.0),)}, "two times"),
        (
            {
                "kind": "sine",
                "low": 0.0,
                "high": 1.0,
                "frequency_hz": 5.0,
                "envelope": {"kind": "decaying", "time_constant_s": 1.0},
            },
            "must be constant",
        ),
    ],
)
def test_command_that_is_not_periodic_is_refused(command_um: dict[str, object], text: str) -> None:
    """A table repeats: its command must end where it begins."""
    with pytest.raises(ValueError, match=text):
        wave(**command_um)


def test_period_must_be_a_whole_number_of_intervals() -> None:
    """Otherwise the table would have another frequency; the nearest one is named."""
    with pytest.raises(DataError, match=r"103\.09\d+ points.*whole number.*194\.17476 Hz is near"):
        points_of("sine 194 Hz", 1 / 194.0, INTERVAL_NS)
    with pytest.raises(DataError, match="at least 16"):
        points_of("sine 2 kHz", 1 / 2000.0, INTERVAL_NS)


def test_interval_must_be_one_of_the_device() -> None:
    """The next legal interval is named."""
    able = RigAxis().capabilities

    assert legal_interval_ns(able, 150.0) == 150_000
    with pytest.raises(DeviceError, match="an interval of 70 µs; the next one that it has is 100"):
        legal_interval_ns(able, 70.0)


def test_harmonics_that_are_left_out_change_nothing_else() -> None:
    """A triangle without its high harmonics keeps its mean and the other harmonics."""
    n = 200
    triangle = PeriodicCommand("triangle", 1.0 - np.abs(1 - 2 * np.arange(n) / n), INTERVAL_NS)
    kept = triangle.harmonics_hz <= 1000.0
    kept[0] = False  # the mean stays all the same
    limited = triangle.only(kept)
    before, after = np.fft.rfft(triangle.values_um), np.fft.rfft(limited.values_um)

    assert after[triangle.harmonics_hz <= 1000.0] == pytest.approx(
        before[triangle.harmonics_hz <= 1000.0]
    )
    assert np.abs(after[triangle.harmonics_hz > 1000.0]).max() < 1e-12


def test_static_gain_grows_with_creep() -> None:
    """Right after a step there is no creep; later there is all of it."""
    creep = model().creep

    assert static_gain(creep, 0.0) == 1.0
    assert static_gain(creep, 1e9) == pytest.approx(1.0 + creep.weights.sum())


def relaxing_maker(path: PathRelaxation) -> TableMaker:
    """Return the maker of tables for a model with a part that relaxes along the path."""
    relaxing = replace(model(), form=SurfaceForm(path=path), weights=RELAXING.weights)
    limits_v = LIMITS.drive_min_v, LIMITS.drive_max_v
    return TableMaker(relaxing, INTERVAL_NS, limits_v, LIMITS.slew_v_per_s)


@pytest.mark.parametrize(("decay", "cycles"), [(0.3, 9), (2.0, 2), (30.0, 1)])
def test_path_is_conditioned_by_swings(decay: float, cycles: int) -> None:
    """They go through the whole range, within the slew rate, until one per cent is left."""
    path, low_v = PathRelaxation(-0.1, decay, 0.1), model().drive_v.low
    table = relaxing_maker(path).conditioning(low_v)

    assert table is not None
    TableGuard(LIMITS, low_v, AtEnd.HOLDS, 10).check(table, low_v)
    assert np.ptp(table.period_v) == pytest.approx(model().drive_v.width, rel=1e-3)
    assert table.cycles == cycles
    small_loops = np.tile([0.0, 0.01], 1000)  # a long path: h is nearly forgotten
    swings = np.tile(model().drive_v.to_unit(table.period_v), cycles)
    drives = np.concatenate((small_loops, swings, [0.0]))
    positions = SurfaceForm(path=path).positions_at(np.zeros(SIZE), drives)
    before, left = np.abs(positions[[small_loops.size, -1]])
    assert before > 1e-3
    assert left < 0.01 * before + 1e-4 * abs(path.weight)


def test_stage_that_rests_inside_its_range_is_conditioned() -> None:
    """Its zero is where it rests after a rise from its lowest voltage; others need nothing."""
    inside = maker().conditioning(40.0)

    assert maker().conditioning(0.0) is None
    assert inside is not None
    assert inside.period_v[0] == pytest.approx(40.0)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(inside.period_v))))
    assert inside.period_v[turns[-1] + 1] == pytest.approx(inside.period_v.min())
    risen = model().zeroed_from_below(40.0)
    assert risen.position_um.to_unit(0.0) < model().zeroed_at(40.0).position_um.to_unit(0.0)


def test_loops_that_do_not_close_are_played_as_they_are() -> None:
    """A displacement above that of the highest voltage is made by a voltage inside the range."""
    assert isinstance(RELAXING.form, SurfaceForm)
    assert RELAXING.form.path
    range_um, drive_v = model().position_um, model().drive_v
    wanted_um = range_um.from_unit(0.9 - 0.105 * np.cos(2.0 * np.pi * np.arange(100) / 100))
    table = relaxing_maker(RELAXING.form.path).table(wanted_um, 0.0, 2)

    drives = drive_v.to_unit(np.concatenate((table.lead_in_v, table.period_v)))
    made = RELAXING.form.positions_at(RELAXING.weights, drives)[-100:]
    assert wanted_um.max() > range_um.high
    assert table.period_v.max() < drive_v.high
    assert range_um.from_unit(made) == pytest.approx(wanted_um, abs=1e-3)
