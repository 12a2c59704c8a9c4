"""Tests of an axis that follows an input of a device, in virtual time."""

from itertools import pairwise
from typing import Any

import pytest

from piezod.config.channels import InputConfig, LineCalibration
from piezod.config.daemon import DaemonConfig
from piezod.messages.requests import Arm, Follow, Goto, Hold, Resume, Stream
from piezod.testing.injections import Injection, InjectionKind
from tests.control.rig_stage import FaultyStage, RigStage, shipped_config, with_axis

KNOB = 1  # second input of the rig


def commanded(**command: Any) -> DaemonConfig:
    """Return the stage with an input of the rig as command, 2 µm per unit."""
    config = shipped_config()
    source = InputConfig(
        device="rig", channel="knob", calibration=LineCalibration(gain=2.0), **command
    )
    return with_axis(config, command_input=source)


class KnobStage(FaultyStage):
    """A stage whose command input a test controls."""

    def __init__(self) -> None:
        super().__init__(commanded())
        self.turn(0.0)
        self.until("SAFE")
        self.do(Arm())

    def turn(self, value: float) -> None:
        """Set the value of the input from now on."""
        self.device.schedule[:] = [Injection(InjectionKind.REPLACED, 0, axis=KNOB, value=value)]

    def unplug(self) -> None:
        """Remove the value of the input."""
        self.device.schedule[:] = [Injection(InjectionKind.DROPPED, 0, axis=KNOB)]


def test_axis_follows_its_command_input() -> None:
    """It follows in µm, by the calibration, no faster than the axis may move."""
    stage = KnobStage()
    stage.do(Follow())
    stage.turn(5.0)
    records = stage.run(0.3)
    steps_um = [
        abs(after.axes[0].command_um - before.axes[0].command_um)
        for before, after in pairwise(records)
    ]

    assert stage.state == "RUN"
    assert stage.x.command_um == pytest.approx(10.0)
    assert stage.x.position_um == pytest.approx(10.0, abs=0.3)
    assert max(steps_um) <= 200.0 * stage.period_ns * 1e-9 + 1e-9


@pytest.mark.fault("C9")
@pytest.mark.parametrize("value", [-0.5, 13.5, None])
def test_values_that_are_not_allowed_are_ignored_and_hold_the_stage_if_they_last(
    value: float | None,
) -> None:
    """Values out of range, or none, are ignored for less than 0.1 s; then the stage holds."""
    stage = KnobStage()
    stage.do(Follow())
    stage.turn(5.0)
    stage.run(0.3)
    for _ in range(5):
        if value is None:
            stage.unplug()
        else:
            stage.turn(value)
        stage.run(0.08)
        stage.turn(5.0)
        stage.run(0.02)
    assert stage.state == "RUN"
    assert stage.x.command_um == pytest.approx(10.0)

    if value is None:
        stage.unplug()
    else:
        stage.turn(value)
    stage.run(0.12)

    assert stage.state == "HOLD"
    [event] = [each for each in stage.events if each.kind == "stream"]
    assert event.text == (
        "the command input gave no value from 0 to 26 µm for 100 ms: the axis stops following it"
    )
    assert event.axis == "x"
    stage.run(3.0)
    assert stage.state == "HOLD"
    stage.do(Resume())
    stage.turn(2.0)
    stage.run(0.2)
    assert stage.x.command_um == pytest.approx(10.0, abs=0.3)


def test_another_movement_ends_following() -> None:
    """The input is still read, but not followed; setpoints of a stream do not mix with it."""
    stage = KnobStage()
    stage.do(Follow(axis="x"))
    stage.turn(5.0)
    stage.run(0.2)
    stage.controller.stream_um(0, 20.0, stage.t_ns)
    stage.run(0.2)
    assert stage.x.command_um == pytest.approx(10.0)

    stage.do(Goto(position_um=3.0))
    stage.run(0.5)
    assert stage.x.command_um == pytest.approx(3.0)
    stage.do(Stream(axes=("x",)))
    stage.run(0.05)
    assert stage.x.command_um == pytest.approx(3.0)
    stage.do(Hold())
    assert stage.state == "HOLD"


@pytest.mark.parametrize(
    ("axis", "why"),
    [
        (None, "there is nothing to follow: the configuration has no `command_input` for x"),
        ("x", "there is nothing to follow: the configuration has no `command_input` for x"),
        ("z", "no axis 'z'; this stage has x"),
    ],
)
def test_axis_without_an_input_cannot_follow(axis: str | None, why: str) -> None:
    """The answer names the missing key; nothing starts."""
    stage = RigStage().armed()
    answer = stage.ask(Follow(axis=axis))

    assert not answer.accepted
    assert answer.why == why
    assert stage.state == "READY"


def test_disarmed_stage_cannot_follow() -> None:
    """Following needs an armed stage, as any movement does."""
    stage = FaultyStage(commanded())
    stage.until("SAFE")

    assert not stage.ask(Follow()).accepted
