"""Tests of takeovers: the first voltage that reaches an amplifier, and the one that stays."""

from collections.abc import Sequence
from itertools import pairwise
from math import nan

import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.gate_reasons import GateReason
from piezod.config.model_file import load_model
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms.shapes import Sine
from piezod.control import controller as stage_controller
from piezod.control.watch.loop import CycleTiming
from piezod.devices.status import DeviceFlag
from piezod.messages import requests as rq
from piezod.testing.injections import InjectionKind
from tests.conftest import Reaction
from tests.control.rig_stage import (
    CONFIG,
    FaultyStage,
    RigStage,
    cycles_until,
    shipped_config,
    with_axis,
)

PAUSE = CycleTiming(0, 400, 10_000, 0, 0)


def config_with(**limits: float) -> DaemonConfig:
    """Return the configuration of the repository with other limits."""
    config = shipped_config()
    return with_axis(config, limits=config.axes["x"].limits.model_copy(update=limits))


def brought_to(stage: RigStage, drive_v: float) -> RigStage:
    """Bring the output to a voltage, as another program would, and wait."""
    stage.channels.write([drive_v], stage.t_ns)
    stage.run(0.1)
    stage.channels.writes.clear()
    return stage


def running(position_um: float = 12.0) -> RigStage:
    """Return a stage that holds a position."""
    stage = RigStage().armed(rq.Goto(position_um=position_um))
    stage.run(0.5)
    return stage


def first_v(stage: RigStage) -> float:
    """Return the first voltage written since the list was cleared, in V."""
    return stage.channels.writes[0][1][0]


@pytest.mark.parametrize("slew_v_per_s", [500.0, 20_000.0])
@pytest.mark.parametrize("there_v", [30.0, 100.0, 149.0])
def test_first_write_is_the_voltage_in_force(slew_v_per_s: float, there_v: float) -> None:
    """It is held. This is so for a slow slew rate and for the earliest `arm`."""
    stage = RigStage(config_with(slew_v_per_s=slew_v_per_s))
    stage.channels.write([there_v], 0)
    stage.t_ns += 50_000_000  # the output settles before the first cycle
    stage.cycle()
    stage.channels.writes.clear()
    stage.do(rq.Arm())
    stage.run(0.1)

    assert stage.state == State.READY
    assert first_v(stage) == pytest.approx(there_v, abs=0.5)
    assert {drive_v for _, (drive_v,) in stage.channels.writes} == {first_v(stage)}


@pytest.mark.fault("A7")
def test_recovered_amplifier_is_taken_over_at_its_present_voltage() -> None:
    """It is lost at 100 V and returns at 0 V: nothing near 100 V is written."""
    stage = FaultyStage(config_with(slew_v_per_s=500.0)).armed(rq.Goto(position_um=18.0))
    stage.run(2.0)
    stage.fail(InjectionKind.REFUSED, 50)
    stage.run(0.1)
    blind = stage.state
    stage.device.deactivate(stage.t_ns)
    stage.run(0.25)
    stage.device.activate(stage.t_ns)
    stage.channels.writes.clear()
    stage.run(2.0)

    assert blind == State.BLIND
    assert max(drive_v for _, (drive_v,) in stage.channels.writes) < 1.0


def test_arming_again_changes_nothing() -> None:
    """It never turns shadow into real writes."""
    stage = RigStage()
    stage.cycle()
    stage.do(rq.Arm(shadow=True), rq.Goto(position_um=12.0))
    stage.run(0.5)
    refused = stage.ask(rq.Arm())
    stage.run(0.1)
    real = running()
    refused_too = real.ask(rq.Arm(shadow=True))
    real.do(rq.Arm(), rq.Stop())
    real.until("SAFE")

    assert (refused.accepted, refused_too.accepted) == (False, False)
    assert stage.channels.writes == []
    assert real.output_v == pytest.approx(0.0, abs=0.5)


def test_voltage_in_force_is_taken_over_after_shadow() -> None:
    """The earliest `arm` holds the voltage in force."""
    stage = brought_to(RigStage(), 40.0)
    stage.do(rq.Arm(shadow=True), rq.Goto(position_um=12.0), rq.Stop())
    while not stage.controller.execute(rq.Arm(), stage.t_ns).accepted or stage.x.drive_v > 1e3:
        stage.cycle()
    stage.cycle()

    assert first_v(stage) == pytest.approx(40.0, abs=0.5)


@pytest.mark.fault("A13")
@pytest.mark.parametrize("request_", [None, rq.Estop()])
def test_amplifier_that_cannot_be_cut_is_ramped(
    request_: rq.Request | None,
) -> None:
    """Deactivating it would leave its output as it is."""
    config = shipped_config()
    cutting = config.axes["x"].safety.model_copy(update={"estop": "cut"})
    stage = FaultyStage(with_axis(config, safety=cutting), holds=True)
    stage.armed(rq.Goto(position_um=12.0))
    stage.run(0.5)
    if request_ is None:
        stage.fail(InjectionKind.FLAGGED, flag=DeviceFlag.OVER_TEMPERATURE)
    else:
        stage.do(request_)
    stage.run(3.0)

    assert stage.state == State.FAULT
    assert stage.output_v == pytest.approx(0.0, abs=0.5)


def test_voltage_outside_the_range_returns_at_the_slew_rate() -> None:
    """A stage is at 149 V, and 100 V are allowed."""
    stage = RigStage(config_with(drive_max_v=100.0, slew_v_per_s=200.0))
    stage.channels.write([149.0], 0)
    stage.t_ns += 50_000_000  # the output settles before the first cycle
    stage.cycle()
    stage.channels.writes.clear()
    stage.do(rq.Arm())
    stage.run(0.4)
    written_v = [drive_v for _, (drive_v,) in stage.channels.writes]
    steps_v = [a - b for a, b in pairwise(written_v)]

    assert written_v[0] == pytest.approx(149.0, abs=1.5)
    assert max(steps_v) <= 1.0 + 1e-9
    assert written_v[-1] == pytest.approx(100.0)


class SilentStage(RigStage):
    """A stage whose amplifier can stop its read-back."""

    silent = False

    def __init__(self) -> None:
        super().__init__()
        read_back = self.channels.read_back

        def answer(now_ns: int) -> Sequence[float]:
            return [nan] if self.silent else read_back(now_ns)

        self.channels.read_back = answer  # type: ignore[attr-defined] # for this test


def test_nothing_is_written_while_the_voltage_is_unknown() -> None:
    """`arm` is refused, and an emergency stop waits for the link."""
    stage = SilentStage()
    stage.cycle()
    stage.silent = True
    stage.run(0.1)
    refused = stage.ask(rq.Arm())
    stage.do(rq.Estop())
    stage.run(0.5)
    blind = stage.state
    stage.silent = False
    stage.run(1.0)

    assert not refused.accepted
    assert blind == State.BLIND
    assert stage.state == State.FAULT
    assert all(drive_v == pytest.approx(0.0, abs=0.1) for _, (drive_v,) in stage.channels.writes)


@pytest.mark.fault("A1")
def test_amplifier_without_read_back_for_some_cycles_is_lost() -> None:
    """Its acknowledgements alone are not sufficient."""
    stage = SilentStage().armed(rq.Goto(position_um=12.0))
    stage.run(0.5)
    stage.silent = True
    stage.run(0.1)

    assert stage.state == State.BLIND


@pytest.mark.fault("S2")
def test_requested_hold_does_not_extend_the_hold_of_a_fault() -> None:
    """After two seconds the stage ramps; the adaptive axis is in feedforward."""
    stage = FaultyStage().armed(rq.SelectMode(mode=Mode.ADAPTIVE), rq.Goto(position_um=12.0))
    stage.run(0.5)
    stage.fail(InjectionKind.REPLACED, value=nan)
    stage.run(0.1)
    held, mode = stage.state, stage.x.mode
    stage.ask(rq.Hold())
    stage.run(2.0)

    assert (held, mode) == (State.HOLD, Mode.FEEDFORWARD)
    assert stage.state == State.RAMP


@pytest.mark.fault("L5")
def test_ramp_continues_at_its_rate_after_a_pause() -> None:
    """It does not catch up two lost seconds."""
    stage = running(18.0)
    stage.do(rq.Stop())
    stage.run(0.1)
    before_v = stage.x.drive_v
    stage.cycle(PAUSE)
    stage.run(0.1)

    assert before_v - stage.x.drive_v == pytest.approx(21 * 0.25, abs=0.1)


@pytest.mark.fault("D7")
def test_cycle_after_skipped_periods_is_not_learned_from(reaction: Reaction) -> None:
    """The stage moved during the skipped periods."""
    stage = running()
    sine = Sine(kind="sine", low=0, high=20, frequency_hz=2)
    stage.do(rq.SelectMode(mode=Mode.ADAPTIVE), rq.Wave(command_um={"x": sine}, duration_s=100))
    stage.run(1.5)
    learned = stage.x.gate
    before = stage.controller.learned(0).weights.copy()
    record = stage.cycle(CycleTiming(0, 2, 10_000, 0, 0))

    assert learned is GateReason.OPEN
    closed = cycles_until([record], lambda each: each.axes[0].gate is GateReason.SKIPPED)
    reaction("D7", cycles=closed)
    assert (stage.controller.learned(0).weights == before).all()


@pytest.mark.fault("P4")
def test_exception_in_watching_or_in_a_request_holds_the_voltage(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The cycles continue; the stage holds, and ends at its safe voltage."""
    stage = running()
    before_v = stage.x.drive_v

    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(stage_controller, "execute", broken)
    answer = stage.controller.execute(rq.Hold(), stage.t_ns)
    monkeypatch.undo()
    stage.cycle()
    held = stage.state
    monkeypatch.setattr(stage.stage.watches[0].sensor, "check", broken)
    broken_too = stage.run(0.01)
    monkeypatch.undo()
    stage.run(5.0)

    assert "ZeroDivisionError" in answer.why
    assert held == State.HOLD
    assert {record.axes[0].drive_v for record in broken_too} == {before_v}
    assert stage.state in {State.SAFE, State.FAULT}
    assert stage.output_v == pytest.approx(0.0, abs=0.5)


@pytest.mark.fault("A3")
def test_ramp_that_does_not_arrive_ends_in_a_reported_fault() -> None:
    """An offset within the tolerance is accepted; a larger one is A3."""
    stage = FaultyStage().armed()
    stage.run(0.1)
    stage.do(rq.Stop())
    stage.fail(InjectionKind.READ_BACK_OFFSET, value=0.7)
    stage.until("SAFE")
    tolerated = stage.state
    stage.do(rq.Arm())
    stage.fail(InjectionKind.READ_BACK_OFFSET, value=3.0)
    stage.run(6.0)

    assert tolerated == State.SAFE
    assert stage.state == State.FAULT
    assert "A3" in stage.faults()


def test_new_model_makes_the_memory_unknown_after_driving() -> None:
    """The memory of the new axis does not contain the past drive."""
    model = load_model(CONFIG.parent / "models" / "simulated-stack.yaml")
    stage = RigStage()
    stage.cycle()
    stage.do(rq.AdoptModel(model=model), rq.Arm(), rq.SelectMode(mode=Mode.ADAPTIVE), rq.Stop())
    stage.until("SAFE")
    stage.do(rq.AdoptModel(model=model), rq.Arm())

    assert not stage.ask(rq.SelectMode(mode=Mode.ADAPTIVE)).accepted


def test_model_that_does_not_hold_at_the_rest_voltage_is_refused() -> None:
    """The loop keeps its present model."""
    file = load_model(CONFIG.parent / "models" / "simulated-stack.yaml")
    stage = RigStage()
    stage.cycle()
    answer = stage.ask(rq.AdoptModel(model=file.model_copy(update={"drive_low_v": 50.0})))

    assert "but the rest voltage is" in answer.why
    assert stage.state == State.SAFE


def test_too_fast_movement_is_refused() -> None:
    """The refusal names the highest speed."""
    stage = running()
    answer = stage.ask(rq.Goto(position_um=1.0, speed_um_per_s=1e5))

    assert answer.why == (
        "speed out of range (got 100000 µm/s), allowed: at most 200 µm/s, "
        "speed_um_per_s of the axis"
    )


@pytest.mark.fault("A10")
def test_amplifier_without_read_back_is_armed_with_a_confirmation() -> None:
    """A person confirms that it is at the safe voltage; the drive starts there."""
    stage = RigStage(reads_back=False)
    stage.cycle()
    refused = stage.ask(rq.Arm())
    stage.do(rq.Arm(confirm_output=True))
    stage.do(rq.Goto(position_um=5.0))
    stage.run(0.5)

    assert "--confirm-output" in refused.why
    assert first_v(stage) == 0.0
    assert stage.x.position_um == pytest.approx(5.0, abs=0.3)
