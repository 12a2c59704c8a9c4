"""User axes of a stage, from requests to voltages."""

from math import isnan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.config.drive_limits import DriveLimit
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms.shapes import Component, Multisine, Sine
from piezod.messages import requests as rq
from tests.control.coupled_stage import TABLE, TWO, CoupledStage, point


def _sine(low: float, high: float) -> Sine:
    return Sine(kind="sine", low=low, high=high, frequency_hz=1.0)


def _round(phase_deg: float) -> Multisine:
    """Return a coordinate of a circle of 1 µm about 5 µm."""
    part = Component(amplitude=1.0, frequency_hz=1.0, phase_deg=phase_deg)
    return Multisine(kind="multisine", low=4.0, components=(part,))


def test_a_user_axis_moves_alone_although_its_actuators_are_coupled() -> None:
    """Coupling of 3 % each way is gone: x arrives, y stays, both actuators help."""
    stage = CoupledStage()
    stage.ask(rq.Path(points=({"x": 5.0, "y": 5.0},)))
    stage.run(1.0)
    assert stage.ask(rq.Goto(axis="x", position_um=8.0)).accepted
    records = stage.run(1.0)
    assert records[-1]["x"].position_um == pytest.approx(8.0, abs=1e-9)
    assert all(record["y"].position_um == pytest.approx(5.0, abs=1e-9) for record in records)
    assert records[-1]["x"].on_target
    assert records[-1]["b"].command_um == pytest.approx(5.0 - 0.03 * records[-1]["a"].command_um)


@pytest.mark.parametrize(("lag_s", "least_um", "most_um"), [(0.0, 0.03, 1.0), (0.02, 0.0, 0.005)])
def test_a_lag_of_the_coupling_is_corrected(lag_s: float, least_um: float, most_um: float) -> None:
    """Four cycles at 200 Hz: y stays while x swings, and is shown where it is."""
    lags = f"lags_s: {{a: {{b: {lag_s}}}, b: {{a: {lag_s}}}}}"
    stage = CoupledStage(TWO.replace("{shares:", f"{{{lags}, shares:"), late_cycles=4)
    stage.ask(rq.Path(points=({"x": 5.0, "y": 5.0},)))
    stage.run(1.0)
    assert stage.ask(rq.Wave(command_um={"x": _sine(3.0, 7.0)}, duration_s=3.0)).accepted
    records = stage.run(4.0)
    assert [record["y"].command_um for record in records] == pytest.approx([5.0] * len(records))
    off_um = max(abs(record["y"].position_um - 5.0) for record in records)
    assert least_um <= off_um <= most_um


def test_a_path_is_straight_and_stops_at_its_points() -> None:
    """All user axes begin and end together, so that every point lies on the line."""
    stage = CoupledStage()
    stage.ask(rq.Path(points=({"x": 2.0, "y": 8.0},)))
    stage.run(1.0)
    answer = stage.ask(rq.Path(points=({"x": 8.0, "y": 5.0}, {"x": 8.0, "y": 2.0})))
    records = stage.run(answer.duration_s + 0.1)
    first = [record for record in records if record["y"].command_um > 5.0]
    assert len(first) > 5
    for record in first:
        x, y = point(record, "x", "y")
        assert y == pytest.approx(8.0 - (x - 2.0) / 2.0, abs=1e-6)
    assert point(records[-1], "x", "y") == pytest.approx([8.0, 2.0])
    assert records[-1]["y"].on_target


@given(st.floats(1.0, 9.0), st.floats(1.0, 9.0))
@settings(max_examples=10, deadline=None)
def test_a_line_keeps_its_direction(x: float, y: float) -> None:
    """Wherever two axes go together, they go straight."""
    stage = CoupledStage()
    stage.ask(rq.Path(points=({"x": 5.0, "y": 5.0},)))
    stage.run(0.6)
    stage.ask(rq.Path(points=({"x": x, "y": y},)))
    for record in stage.run(0.4):
        at_x, at_y = point(record, "x", "y")
        assert (at_x - 5.0) * (y - 5.0) == pytest.approx((at_y - 5.0) * (x - 5.0), abs=1e-5)


def test_a_table_tilts_by_three_actuators() -> None:
    """Height and both angles arrive; the actuators are where geometry puts them."""
    stage = CoupledStage(TABLE, "abc", share=0.0)
    stage.ask(rq.Path(points=({"z": 5.0, "rx": 200.0, "ry": -100.0},)))
    record = stage.run(1.0)[-1]
    assert record["z"].position_um == pytest.approx(5.0)
    assert record["rx"].position_um == pytest.approx(200.0)
    assert record["ry"].position_um == pytest.approx(-100.0)
    assert record["a"].command_um == pytest.approx(7.0)
    assert record["b"].command_um == pytest.approx(5.0 - 1.0 - 0.866)
    assert isnan(record["z"].drive_v)


def test_a_movement_beyond_an_actuator_is_refused_with_its_number() -> None:
    """Each user axis is within its range, and one actuator would have to go beyond its own."""
    stage = CoupledStage(TABLE, "abc", share=0.0)
    stage.ask(rq.Path(points=({"z": 5.0},)))
    stage.run(1.0)
    answer = stage.ask(rq.Path(points=({"z": 8.0, "rx": 400.0},)))
    assert not answer.accepted
    assert "axis a" in answer.why
    assert "12 µm" in answer.why
    assert stage.run(0.1)[-1]["z"].command_um == pytest.approx(5.0)


def test_a_stream_stops_on_its_way_at_a_limit() -> None:
    """An actuator at its limit stops all user axes on the straight way, which is told once."""
    stage = CoupledStage(TABLE, "abc", share=0.0)
    stage.ask(rq.Path(points=({"z": 5.0},)))
    stage.run(1.0)
    assert stage.ask(rq.Stream(axes=("z", "rx"))).accepted
    for _ in range(100):
        stage.set(z=9.0, rx=400.0)  # needs a at 13 µm
        record = stage.run(0.02)[-1]
        z, rx = point(record, "z", "rx")
        assert rx == pytest.approx(100.0 * (z - 5.0), abs=1e-6)
        assert record["a"].command_um <= 10.0 + 1e-6
    assert record["a"].command_um == pytest.approx(10.0)
    assert record["rx"].limited is DriveLimit.RANGE
    assert sum(event.kind == "limit" for event in stage.events) == 1


def test_a_stream_that_ends_holds_the_stage() -> None:
    """Without setpoints the stage holds, as with a stream of an axis."""
    stage = CoupledStage()
    stage.ask(rq.Stream(axes=("x", "y")))
    stage.set(x=3.0, y=3.0)
    stage.run(0.5)
    assert stage.controller.state is State.HOLD
    assert any(event.kind == "stream" for event in stage.events)


def test_the_other_axes_go_on() -> None:
    """A movement of one user axis leaves the wave of another one as it is."""
    stage = CoupledStage()
    stage.ask(rq.Path(points=({"x": 5.0, "y": 5.0},)))
    stage.run(1.0)
    stage.ask(rq.Wave(command_um={"y": _sine(4.0, 6.0)}, duration_s=3.0))
    before = stage.run(1.0)
    stage.ask(rq.Goto(axis="x", position_um=7.0))
    after = stage.run(1.0)
    for one, next_one in zip(before[-100:], after[-100:], strict=True):
        assert one["y"].command_um == pytest.approx(next_one["y"].command_um, abs=0.05)
    assert after[-1]["x"].command_um == pytest.approx(7.0)
    assert after[-1]["y"].motion == before[-1]["y"].motion


def test_a_movement_goes_on_after_the_axes_were_held() -> None:
    """After hold and resume the user axes stay, and the next movement begins there."""
    stage = CoupledStage()
    stage.ask(rq.Path(points=({"x": 8.0, "y": 8.0},), speed_per_s=10.0))
    stage.run(0.3)
    stage.ask(rq.Hold())
    stage.run(0.2)
    stage.ask(rq.Resume())
    held = point(stage.run(0.1)[-1], "x", "y")
    assert held[0] == pytest.approx(held[1], abs=0.01)
    assert held[0] < 8.0
    stage.ask(rq.Goto(axis="x", position_um=8.0))
    records = stage.run(1.0)
    assert records[-1]["x"].command_um == pytest.approx(8.0)
    assert records[-1]["y"].command_um == pytest.approx(held[1], abs=1e-3)


def test_waves_of_user_axes_begin_together() -> None:
    """A circle is round from its first point on, although the ways to it differ."""
    stage = CoupledStage()
    stage.ask(rq.Path(points=({"x": 2.0, "y": 5.0},)))
    stage.run(1.0)
    waves = rq.Wave(command_um={"x": _round(90.0), "y": _round(0.0)}, duration_s=1.0)
    answer = stage.ask(waves)
    records = stage.run(answer.duration_s)
    for record in records[-180:]:
        x, y = point(record, "x", "y")
        assert ((x - 5.0) ** 2 + (y - 5.0) ** 2) ** 0.5 == pytest.approx(1.0, abs=0.01)


def test_a_sensor_that_is_lost_is_missing_where_it_is_needed() -> None:
    """Coupling mixes the sensors: without one of them no user axis has a position."""
    stage = CoupledStage()
    stage.devices.invalid.add(1)
    record = stage.run(0.1)[-1]
    assert isnan(record["x"].position_um)
    assert isnan(record["b"].position_um)


@pytest.mark.parametrize(
    ("request_", "word"),
    [
        (rq.Goto(axis="a", position_um=5.0), "x, y"),
        (rq.Goto(position_um=5.0), "x, y"),
        (rq.Goto(axis="x", position_um=9.5), "allowed range 1 to 9 µm"),
        (rq.Goto(axis="x", position_um=8.0, speed_um_per_s=500.0), "at most 100"),
        (rq.Path(points=({"q": 5.0},)), "q"),
        (rq.Path(points=({"a": 5.0},)), "x, y"),
        (rq.Wave(command_um={"a": _sine(1.0, 2.0)}, duration_s=1.0), "x, y"),
        (rq.Identify(drive_v={"x": _sine(0.0, 9.0)}, duration_s=1.0), "a, b"),
    ],
)
def test_what_cannot_move_is_refused(request_: rq.Request, word: str) -> None:
    """An actuator is not moved past its user axes, and a user axis has no voltage."""
    answer = CoupledStage().ask(request_)
    assert not answer.accepted
    assert word in answer.why


def test_a_mode_of_a_user_axis_is_that_of_its_actuators() -> None:
    """All actuators of a user axis change their mode together."""
    stage = CoupledStage()
    assert stage.ask(rq.SelectMode(mode=Mode.UNCOMPENSATED, axis="x")).accepted
    record = stage.run(0.1)[-1]
    assert {record[name].mode for name in "abxy"} == {Mode.UNCOMPENSATED}


def test_a_failure_of_the_user_axes_keeps_the_voltages(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mistake in the coordinates is a fault, and the cycle goes on."""
    stage = CoupledStage()
    stage.ask(rq.Path(points=({"x": 5.0, "y": 5.0},)))
    stage.run(1.0)
    users = stage.controller.users
    assert users is not None
    monkeypatch.setattr(users, "_mixed", None)
    stage.run(0.1)
    assert any(event.fault == "P4" for event in stage.events)
    assert stage.controller.state is not State.RUN
