"""Tests of modes `trimmed` and `closed`, with a made-up stage that differs from the model."""

from collections.abc import Callable

import numpy as np
import pytest

from piezod.config.modes import CORRECTED, Mode
from piezod.control.guard import Limits
from piezod.control.law.axis import CompensatedAxis
from piezod.control.law.compensator import Compensator, DriveHistory
from piezod.control.law.identifier import Identifier, LearningGate
from piezod.control.law.learned_models import ModelProof
from piezod.control.law.trim import NotchedTrim, Trim
from piezod.control.reference.preview import ReferenceShaper
from piezod.devices.interface import Sample
from piezod.dynamics import Resonance
from piezod.dynamics.notch import notch
from piezod.hysteresis import AffineRange, Convergence, LearnedModel, NLMSIdentifier
from tests.control.fakes import MS
from tests.control.made_up import BANK, FORM, WEIGHTS, Array, MadeUpStage, wander

RANGE = AffineRange(0.0, 1.0)
FADE = 100
AUTHORITY = 0.05
NOTCH = notch(Resonance(350.0, 0.03), 1e-3)
SWITCH = 1000
"""Cycle of the change of mode."""
SPIKE_AT = 700
"""Cycle of the spike of the sensor."""


def axis_of(reference: Callable[[float], float], mode: Mode, *, adapts: bool) -> CompensatedAxis:
    """Return an axis with the right hysteresis and no creep; its trim fades in 100 ms."""
    history = DriveHistory(0.0, entries=8)
    adaptation = NLMSIdentifier(BANK, gain=0.05)
    adaptation.adopt(0.7 * WEIGHTS)
    converged = Convergence(0.01, 100)
    learning = frozenset({Mode.ADAPTIVE, *(CORRECTED if adapts else ())})
    return CompensatedAxis(
        reference_um=reference,
        drive_v=RANGE,
        position_um=RANGE,
        compensator=Compensator(FORM, WEIGHTS, mode=mode, fade_cycles=FADE, learning=learning),
        identifier=Identifier(
            adaptation, RANGE, RANGE, history, 0, MS, converged, LearningGate(MS)
        ),
        history=history,
        limits=Limits(0.0, 1.0, 1e9),
        in_force_v=0.0,
        start_ns=0,
        period_ns=MS,
        delay_ns=0,
        sensor_delay_ns=0,
        proof=ModelProof(LearnedModel(WEIGHTS.copy()), window_cycles=1000, lag_cycles=3),
        feedbacks={
            Mode.TRIMMED: Trim(50.0, 1e-3, AUTHORITY, FADE),
            Mode.CLOSED: NotchedTrim(
                150.0, 1e-3, 4.0 * AUTHORITY, 4 * FADE, proportional=0.1, notches=[NOTCH]
            ),
        },
        shaper=ReferenceShaper(1e-3),
    )


def run(
    start: Mode, end: Mode, commands: Array, *, adapts: bool = False, spike: float = 0.0
) -> tuple[Array, Array]:
    """Return drives and positions, shape (n,), with a spike and a change of mode."""

    def reference(t_s: float) -> float:
        return float(commands[min(max(round(1e3 * t_s), 0), commands.size - 1)])

    axis, stage = axis_of(reference, start, adapts=adapts), MadeUpStage()
    out, in_force = [], 0.0
    for k in range(commands.size):
        if k == SWITCH:
            axis.switch(end)
        position = stage.step(in_force)
        measured = position + (spike if k == SPIKE_AT else 0.0)
        output = axis.update(k * MS, Sample(k * MS, measured, valid=True))
        axis.applied(output.drive_v)
        out.append((in_force, position))
        in_force = output.drive_v
    drives, positions = np.array(out).T
    return drives, positions


@pytest.mark.parametrize("adapts", [False, True])
@pytest.mark.parametrize("mode", CORRECTED)
def test_feedback_removes_the_error_of_the_model(adapts: bool, mode: Mode) -> None:
    """Creep of 4 %, which the model lacks, is removed soon after the change of mode."""
    commands = np.full(2000, 0.8)

    _, positions = run(Mode.FEEDFORWARD, mode, commands, adapts=adapts)

    assert positions[SWITCH] - 0.8 > 0.02
    assert positions[SWITCH + 200 :] == pytest.approx(0.8, abs=2e-4)


@pytest.mark.parametrize("moving", [False, True])
def test_closed_leaves_less_error_than_trimmed(moving: bool) -> None:
    """Its gain is larger; the model lacks the creep of the stage."""
    commands = wander(2.0) if moving else np.minimum(np.arange(2000) / 500, 0.8)

    def worst(mode: Mode) -> float:
        _, positions = run(mode, mode, commands)
        return float(np.abs(positions[101:] - commands[100:-1]).max())

    assert worst(Mode.CLOSED) < 0.9 * worst(Mode.TRIMMED)


@pytest.mark.parametrize("adapts", [False, True])
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("corrected", CORRECTED)
@pytest.mark.parametrize("other", Mode)
@pytest.mark.parametrize("into", [False, True])
@pytest.mark.few(24)
def test_switch_is_bumpless(
    adapts: bool, moving: bool, corrected: Mode, other: Mode, into: bool
) -> None:
    """No step of the drive is larger than command and feedback explain."""
    commands = wander(2.0) if moving else np.minimum(np.arange(2000) / 500, 0.8)
    start, end = (other, corrected) if into else (corrected, other)

    drives, _ = run(start, end, commands, adapts=adapts)

    steps = np.abs(np.diff(drives))
    usual = steps[1:SWITCH].max() if moving else 0.0
    assert steps[SWITCH - 1 : SWITCH + 3 * FADE].max() < 1.3 * usual + 5e-3
    assert np.ptp(drives[SWITCH - 1 : SWITCH + 3 * FADE]) > (
        5e-3 if other is Mode.UNCOMPENSATED else 0.0
    )


def test_trim_fades_when_the_mode_is_left() -> None:
    """After the fade the drive is that of the other mode, and stays."""
    commands = np.full(2000, 0.8)

    for other, drive in ((Mode.UNCOMPENSATED, 0.8), (Mode.FEEDFORWARD, None)):
        drives, _ = run(Mode.TRIMMED, other, commands)
        after = drives[SWITCH + FADE + 2 :]

        assert np.ptp(after) < 1e-9
        assert abs(after[0] - drives[SWITCH]) > 0.01
        assert drive is None or after[0] == pytest.approx(drive, abs=1e-9)


@pytest.mark.parametrize("mode", CORRECTED)
def test_feedback_does_not_wind_up_at_the_end_of_the_range(mode: Mode) -> None:
    """While creep keeps the stage above rest, the feedback does not grow."""
    there_and_back = np.repeat([0.9, 0.0], SWITCH // 2)
    commands = np.concatenate((there_and_back, np.full(1000, 0.5)))

    _, positions = run(mode, mode, commands)

    assert positions[SWITCH - 300 : SWITCH - 1].min() > 0.003
    assert np.abs(positions[SWITCH + 2 : SWITCH + 10] - 0.5).max() < 0.035  # 0.05 more with wind-up
    assert positions[SWITCH + 200 :] == pytest.approx(0.5, abs=5e-4)


@pytest.mark.parametrize("spike", [0.1, -0.1])
def test_spike_does_not_move_the_trim(spike: float) -> None:
    """A sample that is 10 % off moves the drive by less than a thousandth of that."""
    commands = wander(2.0)

    clean, _ = run(Mode.TRIMMED, Mode.TRIMMED, commands)
    spiked, _ = run(Mode.TRIMMED, Mode.TRIMMED, commands, spike=spike)

    assert np.abs(spiked - clean).max() < 1e-3 * abs(spike)
