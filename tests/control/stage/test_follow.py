"""An axis that follows an input of a device, in virtual time."""

from itertools import pairwise
from typing import Any

import pytest

from piezod.config.channels import InputConfig, LineCalibration
from piezod.config.daemon import DaemonConfig
from piezod.config.requests import Arm, Follow, Goto, Hold, Resume, Stream
from piezod.testing.injections import Injection, InjectionKind
from tests.control.live_stage import FaultyStage, LiveStage, shipped

KNOB = 1  # the rig's second input


def commanded(**command: Any) -> DaemonConfig:
    """Return the stage that ships, its axis commanded by an input of the rig, 2 µm per unit."""
    config = shipped()
    told = InputConfig(
        device="rig", channel="knob", calibration=LineCalibration(gain=2.0), **command
    )
    axis = config.axes["x"].model_copy(update={"command_input": told})
    return config.model_copy(update={"axes": {"x": axis}})


class Knob(FaultyStage):
    """A stage whose command input shows what a test wants."""

    def __init__(self) -> None:
        super().__init__(commanded())
        self.turn(0.0)
        self.until("SAFE")
        self.do(Arm())

    def turn(self, value: float) -> None:
        """Have it show a value from now on."""
        self.device.schedule[:] = [Injection(InjectionKind.REPLACED, 0, axis=KNOB, value=value)]

    def unplug(self) -> None:
        """Have it show nothing."""
        self.device.schedule[:] = [Injection(InjectionKind.DROPPED, 0, axis=KNOB)]


def test_an_axis_goes_where_its_input_tells_it() -> None:
    """In µm, by its calibration, and no faster than the axis may move."""
    stage = Knob()
    stage.do(Follow())
    stage.turn(5.0)
    way = stage.run(0.3)
    steps_um = [
        abs(after.axes[0].command_um - before.axes[0].command_um) for before, after in pairwise(way)
    ]

    assert stage.state == "RUN"
    assert stage.x.command_um == pytest.approx(10.0)
    assert stage.x.position_um == pytest.approx(10.0, abs=0.3)
    assert max(steps_um) <= 200.0 * 1e-3 + 1e-9


@pytest.mark.fault("C9")
@pytest.mark.parametrize("value", [-0.5, 13.5, None])
def test_what_is_not_usable_is_left_out_and_held_where_it_lasts(value: float | None) -> None:
    """Beyond the range of commands, or nothing: 0.1 s of it is too much, less is not."""
    stage = Knob()
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
    [told] = [event for event in stage.events if event.kind == "stream"]
    assert told.text == (
        "the command input gave no value from 0 to 26 µm for 100 ms: the axis stops following it"
    )
    assert told.axis == "x"
    stage.run(3.0)
    assert stage.state == "HOLD"
    stage.do(Resume())
    stage.turn(2.0)
    stage.run(0.2)
    assert stage.x.command_um == pytest.approx(10.0, abs=0.3)


def test_another_movement_ends_it() -> None:
    """The input is read on, and nobody follows it; setpoints of a stream do not mix with it."""
    stage = Knob()
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
def test_an_axis_without_an_input_cannot_follow_it(axis: str | None, why: str) -> None:
    """The answer says what the configuration lacks; nothing begins."""
    stage = LiveStage()
    stage.until("SAFE")
    stage.do(Arm())
    answer = stage.ask(Follow(axis=axis))

    assert not answer.accepted
    assert answer.why == why
    assert stage.state == "READY"


def test_a_stage_that_is_not_armed_cannot_follow() -> None:
    """As any movement."""
    stage = FaultyStage(commanded())
    stage.until("SAFE")

    assert not stage.ask(Follow()).accepted
