"""An axis as a motor record: what its clients see of a movement."""

import pytest

from piezod.client.facts import AxisFacts
from piezod.errors import RefusedError
from piezod.ioc.axis_motor import AxisMotor
from piezod.ioc.readings import DOWN, FAULTY, OK, REFUSED, UNKNOWN, WARNING
from piezod.messages.answers import Answer
from tests.ioc.fakes import FakeMotor, axis

LIMITS = AxisFacts((0.0, 20.0), 100.0, tolerance_um=0.1, longest_move_s=0.375)


@pytest.fixture
def record() -> FakeMotor:
    """Return the record of an axis."""
    return FakeMotor()


@pytest.fixture
def motor(record: FakeMotor) -> AxisMotor:
    """Return an axis with a sensor that stays at 1 µm."""
    motor = AxisMotor(record, has_sensor=True)
    motor.limit(LIMITS)
    motor.feed("RUN", axis(on_target=True))
    record.done.clear()
    record.failed.clear()
    return motor


def answer(motion: int) -> Answer:
    """Return the answer of the daemon to a movement."""
    return Answer(motion=motion, state="RUN")


def test_movement_goes_on_from_the_write_to_the_target(motor: AxisMotor, record: FakeMotor) -> None:
    """DMOV is 0 from the write on, also in intervals from before the movement."""
    motor.begin(5.0)
    motor.feed("RUN", axis(on_target=True))
    motor.accepted(5.0, answer(1))
    motor.feed("RUN", axis(on_target=True))
    motor.feed("RUN", axis(3.0, 5.0, motion=1))
    moving = dict(record.fields)
    motor.feed("RUN", axis(5.0, 5.0, motion=1, on_target=True))

    assert (moving["DMOV"], moving["MOVN"], moving["VAL"], moving["RBV"]) == (0, 1, 5.0, 3.0)
    assert record.done == [0.0, 1.0]
    assert (record.fields["MOVN"], record.fields["RBV"], record.alarm) == (0, 5.0, OK)


def test_noise_at_the_target_is_no_movement(motor: AxisMotor, record: FakeMotor) -> None:
    """An axis that has arrived stays done until the next movement."""
    motor.feed("RUN", axis(on_target=False))
    motor.feed("RUN", axis(on_target=True))

    assert record.done == []


def test_movement_that_ends_early_has_an_alarm(motor: AxisMotor, record: FakeMotor) -> None:
    """A hold ends the movement with an alarm, which the next accepted write ends."""
    motor.begin(5.0)
    motor.accepted(5.0, answer(1))
    motor.feed("HOLD", axis(3.0, 5.0, motion=1))
    held = record.fields["DMOV"], record.alarm
    motor.feed("RUN", axis(3.0, 3.0, motion=2, on_target=True))
    resumed = record.alarm
    motor.begin(4.0)

    assert held == (1, FAULTY)
    assert resumed == FAULTY
    assert record.alarm == OK


def test_refused_write_on_the_way_does_not_fail_the_movement(
    motor: AxisMotor, record: FakeMotor
) -> None:
    """Its alarm stays, and the movement arrives; the next one is held, and fails."""
    motor.begin(5.0)
    motor.accepted(5.0, answer(1))
    motor.feed("RUN", axis(3.0, 5.0, motion=1))
    motor.refused()
    motor.feed("RUN", axis(5.0, 5.0, motion=1, on_target=True))
    alarm = record.alarm
    motor.begin(6.0)
    motor.accepted(6.0, answer(2))
    motor.feed("HOLD", axis(5.5, 6.0, motion=2))

    assert alarm == REFUSED
    assert record.failed == [False, True]


def stop(motor: AxisMotor, *, asked: bool = True) -> None:
    """Stop a stage that still moves in the next interval."""
    with motor.stopping(asked=asked):
        motor.feed("RUN", axis(3.0, 5.0, motion=1))
    motor.feed("RUN", axis(3.1, 5.0, motion=1))


@pytest.mark.parametrize("held", [True, False], ids=["HOLD is seen", "HOLD is between intervals"])
@pytest.mark.parametrize("on_target", [True, False])
def test_stop_ends_the_movement_where_it_is(
    motor: AxisMotor, record: FakeMotor, held: bool, on_target: bool
) -> None:
    """VAL is RBV before DMOV rises, once; there is no alarm, and a tweak goes on from there."""
    motor.begin(5.0)
    motor.accepted(5.0, answer(1))
    stop(motor)
    if held:
        motor.feed("HOLD", axis(3.2, None, motion=1))
    motor.feed("RUN", axis(3.2, 3.25, command_um=3.25, motion=2, on_target=on_target))
    motor.feed("RUN", axis(3.3, 3.25, command_um=3.25, motion=2, on_target=True))
    record.fields["TWV"] = 1.0

    assert record.done == [0.0, 1.0]
    assert record.targets_when_done == [3.2]
    assert (record.fields["VAL"], record.alarm, record.failed) == (3.2, OK, [False])
    assert motor.tweaked_um(1.0) == 4.2


def test_stop_for_another_axis_fails_the_movement(motor: AxisMotor, record: FakeMotor) -> None:
    """A stop holds the whole stage: who moves this axis learns that it has not arrived."""
    motor.begin(5.0)
    motor.accepted(5.0, answer(1))
    stop(motor, asked=False)
    motor.feed("RUN", axis(3.2, 3.25, command_um=3.25, motion=2))

    assert (record.done, record.failed, record.alarm) == ([0.0, 1.0], [True], FAULTY)
    assert record.fields["VAL"] == 3.2


def test_stop_that_failed_ends_nothing(motor: AxisMotor, record: FakeMotor) -> None:
    """The movement goes on to its target."""
    motor.begin(5.0)
    motor.accepted(5.0, answer(1))
    with pytest.raises(RefusedError), motor.stopping(asked=True):
        raise RefusedError("not allowed")
    motor.feed("RUN", axis(3.0, 5.0, motion=1))
    motor.feed("RUN", axis(5.0, 5.0, motion=1, on_target=True))

    assert record.done == [0.0, 1.0]
    assert record.fields["VAL"] == 5.0


@pytest.mark.parametrize("state", ["HOLD", "FAULT", "RAMP"])
def test_whatever_ends_a_movement_leaves_no_old_target(
    motor: AxisMotor, record: FakeMotor, state: str
) -> None:
    """Neither VAL nor a tweak goes back to a target that was given up; resuming moves nothing."""
    motor.begin(5.0)
    motor.accepted(5.0, answer(1))
    motor.feed("RUN", axis(3.0, 5.0, motion=1))
    motor.feed(state, axis(3.2, None, motion=1))
    ended = dict(record.fields)
    motor.feed("RUN", axis(3.1, 3.25, command_um=3.25, motion=2))

    assert (ended["VAL"], ended["DMOV"]) == (3.2, 1)
    assert record.done == [0.0, 1.0]
    assert record.targets_when_done == [3.2]


def test_target_after_a_stop_is_a_movement(motor: AxisMotor, record: FakeMotor) -> None:
    """One that is written while the stop waits for its answer shows as one movement with it."""
    motor.begin(5.0)
    motor.accepted(5.0, answer(1))
    with motor.stopping(asked=True):
        motor.begin(6.0)
    motor.accepted(6.0, answer(3))
    motor.feed("RUN", axis(3.2, 3.2, motion=2))
    motor.feed("RUN", axis(3.2, 6.0, command_um=3.3, motion=3))
    motor.feed("RUN", axis(6.0, 6.0, command_um=6.0, motion=3, on_target=True))

    assert record.done == [0.0, 1.0]
    assert (record.fields["VAL"], record.alarm) == (6.0, OK)


@pytest.mark.parametrize("speed_um_per_s", [100.0, 10.0])
def test_clients_formulas_give_a_movement_its_time(
    motor: AxisMotor, record: FakeMotor, speed_um_per_s: float
) -> None:
    """The way over VELO, and ACCL, is no less than any movement takes."""
    assert motor.take_speed(speed_um_per_s) == ""
    for way_um in (0.1, 1.0, 10.0, 20.0):
        takes_s = 1.875 * way_um / speed_um_per_s
        assert way_um / speed_um_per_s + record.fields["ACCL"] >= takes_s


def test_refusal_of_the_daemon_restores_the_target(motor: AxisMotor, record: FakeMotor) -> None:
    """The record gets back the target that it had, and an alarm."""
    motor.begin(5.0)
    motor.rejected()
    motor.feed("SAFE", axis(1.1, None))

    assert (record.fields["VAL"], record.fields["DMOV"]) == (1.0, 1)
    assert record.alarm == REFUSED


def test_limits(motor: AxisMotor, record: FakeMotor) -> None:
    """Positions beyond the limits, and what is no number, are refused with the range."""
    assert motor.why_not(20.0) == ""
    assert "allowed range 0 to 20 um" in motor.why_not(20.5)
    assert motor.why_not(float("nan"))
    assert motor.take_speed(100.0) == ""
    assert "at most 100" in motor.take_speed(101.0)
    assert motor.take_speed(0.0)

    motor.refused()
    assert (record.fields["LVIO"], record.alarm) == (1, REFUSED)
    assert (record.fields["LLM"], record.fields["HLM"], record.fields["VMAX"]) == (0.0, 20.0, 100.0)


def test_speed_follows_a_lower_limit(motor: AxisMotor, record: FakeMotor) -> None:
    """A speed above the new limit becomes the limit; a lower one stays."""
    record.fields["VELO"] = 50.0
    motor.limit(AxisFacts((0.0, 20.0), 80.0))
    kept = record.fields["VELO"]
    motor.limit(AxisFacts((0.0, 20.0), 40.0))

    assert (kept, record.fields["VELO"]) == (50.0, 40.0)


def test_daemon_that_is_gone(motor: AxisMotor, record: FakeMotor) -> None:
    """The record is INVALID, its movement over, and writes are refused until it is back."""
    motor.begin(5.0)
    motor.down()
    gone = record.alarm, record.fields["DMOV"]
    refused = motor.why_not(5.0)
    motor.refused()
    still = record.alarm
    motor.rejected()

    assert gone == (DOWN, 1)
    assert "does not answer" in refused
    assert still == DOWN
    assert record.alarm == DOWN


@pytest.mark.parametrize(
    ("state", "position_um", "alarm"),
    [
        ("READY", 1.0, OK),
        ("HOLD", 1.0, WARNING),
        ("FAULT", 1.0, FAULTY),
        ("RUN", None, UNKNOWN),
        ("FAULT", None, UNKNOWN),
    ],
)
def test_alarms(
    motor: AxisMotor, record: FakeMotor, state: str, position_um: float | None, alarm: object
) -> None:
    """The most serious of state and position is the alarm."""
    motor.feed(state, axis(position_um))

    assert record.alarm == alarm


def test_another_client_moves_the_axis(motor: AxisMotor, record: FakeMotor) -> None:
    """The record shows its target, and that the axis moves."""
    motor.feed("RUN", axis(1.0, 7.0, motion=4))
    motor.feed("RUN", axis(7.0, 7.0, motion=4, on_target=True))

    assert record.fields["VAL"] == 7.0
    assert record.done == [0.0, 1.0]


def test_axis_without_a_sensor(record: FakeMotor) -> None:
    """Its read-back is the command, and it arrives when the command does."""
    motor = AxisMotor(record, has_sensor=False)
    motor.feed("RUN", axis(None, 5.0, command_um=3.0, motion=1))
    moving = record.fields["DMOV"], record.fields["RBV"]
    motor.feed("RUN", axis(None, 5.0, command_um=5.0, motion=1))

    assert moving == (0, 3.0)
    assert (record.fields["DMOV"], record.alarm) == (1, OK)


def test_tweak(motor: AxisMotor, record: FakeMotor) -> None:
    """A tweak is relative to the target."""
    record.fields["TWV"] = 0.5

    assert (motor.tweaked_um(1.0), motor.tweaked_um(-1.0)) == (1.5, 0.5)
