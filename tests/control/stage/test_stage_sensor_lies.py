"""Tests of a sensor that is wrong but steady: what a stage learns from it, and what stays."""

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.faults import Fault
from piezod.config.gate_reasons import GateReason
from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Sine
from piezod.control.controller import Learned
from piezod.control.faults.cases import DOUBTING
from piezod.control.faults.detection import Detection
from piezod.control.law.learned_models import ModelDrift
from piezod.control.law.model_files import read_model
from piezod.devices.interface import Sample
from piezod.hysteresis import LearnedModel
from piezod.messages import requests as rq
from piezod.testing.faulty import FaultyDevice, SensorAmplifier
from tests.control.rig_stage import FaultyStage, RigStage, quick_config
from tests.control.surface_rig import CLASSES, with_model

RANGE_UM = 31.3
BOUND = 0.05
"""Default of `learned_pct`, as a share of the range."""
WAVE = rq.Wave(
    command_um={"x": Sine(kind="sine", low=4.0, high=22.0, frequency_hz=0.5)}, duration_s=1000.0
)
Lie = Callable[[float, float], float]
"""Seconds since it began, and the true sample in µm, to the sample that is shown, in µm."""
FAR: dict[str, Lie] = {
    "1.4 times": lambda _t_s, x_um: 1.4 * x_um,
    "0.6 times": lambda _t_s, x_um: 0.6 * x_um,
    "5 µm more": lambda _t_s, x_um: x_um + 5.0,
    "mirrored": lambda _t_s, x_um: 24.0 - x_um,
}
NEAR: dict[str, Lie] = {
    "1.15 times": lambda t_s, x_um: (1.0 + min(0.05 * t_s, 0.15)) * x_um,
    "0.9 times": lambda t_s, x_um: (1.0 - min(0.05 * t_s, 0.1)) * x_um,
    "2 µm more": lambda t_s, x_um: x_um + min(t_s, 2.0),
    "grows slowly": lambda t_s, x_um: (1.0 + 0.005 * t_s) * x_um,
}


class LyingRig(FaultyDevice):
    """A rig whose sensor may lie."""

    def __init__(self, device: SensorAmplifier) -> None:
        super().__init__(device)
        self._lie: Lie | None = None
        self._since_ns = 0

    def begin(self, lie: Lie | None, now_ns: int) -> None:
        """Lie from an instant on; None ends it."""
        self._lie, self._since_ns = lie, now_ns

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return what the sensor shows."""
        (sample,) = super().read(now_ns)
        if self._lie is None:
            return [sample]
        shown_um = self._lie((now_ns - self._since_ns) / 1e9, sample.position_um)
        return [sample._replace(position_um=shown_um)]


class LyingStage(FaultyStage):
    """A stage that moves in a mode, on a rig whose sensor may lie."""

    def __init__(self, config: DaemonConfig, mode: Mode = Mode.ADAPTIVE) -> None:
        super().__init__(config, faulty=LyingRig)
        self.rig = cast("LyingRig", self.device)
        self.move(mode)
        file = config.axes["x"].model
        assert file is not None
        self._model = read_model(file)[0]

    @property
    def learned(self) -> Learned:
        """What is published, and can be saved."""
        return self.controller.learned(0)

    @property
    def moved(self) -> float:
        """How far that is from the model, as a share of the range."""
        learned = self.learned
        return ModelDrift(self._model).measure(
            LearnedModel(learned.weights.copy(), learned.offset, learned.scale)
        )

    def move(self, mode: Mode) -> None:
        """Arm if need be, and follow the wave."""
        self.until("SAFE")
        self.do(rq.Arm(), rq.SelectMode(mode=mode), WAVE)

    def lie(self, lie: Lie | None) -> None:
        """Begin or end a lie."""
        self.rig.begin(lie, self.t_ns)

    def to_safe(self) -> None:
        """Come to rest, and end the faults, as a person does."""
        self.ask(rq.Stop())
        for _ in range(5):
            self.run(3.0)
            self.ask(rq.Reset(engineer=True))
            if self.state == "SAFE":
                return

    def feedforward_um(self, position_um: float) -> float:
        """Go to a position in feedforward, after conditioning; return the true position, in µm."""
        self.do(rq.Arm(), rq.Condition())
        self.until("READY")
        self.do(rq.SelectMode(mode=Mode.FEEDFORWARD), rq.Goto(position_um=position_um))
        self.run(2.0)
        return self.rig.true_position_um(self.t_ns)[0]


@pytest.mark.parametrize("model", CLASSES)
@pytest.mark.parametrize("lie", FAR)
@pytest.mark.few(3)
def test_nothing_stays_of_a_lie_that_is_found(model: str, lie: str) -> None:
    """A fault drops what was learned before it, and resets in a loop teach nothing that stays."""
    stage = LyingStage(with_model(quick_config(), model))
    stage.run(3.0)
    honest = stage.learned.weights.copy()
    stage.lie(FAR[lie])
    for _ in range(3):
        stage.run(3.0)
        assert stage.stage.register.latched, "the lie is found"
        assert stage.moved == 0.0
        assert stage.x.gate is GateReason.DOUBTED
        stage.to_safe()
        if not stage.ask(rq.Arm()).accepted:  # the sensor contradicts the voltage at rest, too
            break
        stage.ask(rq.SelectMode(mode=Mode.ADAPTIVE))
        stage.ask(WAVE)
    stage.run(3.0)
    stage.lie(None)
    stage.to_safe()

    first = stage.stage.axes[0].law.proof.first.weights
    assert not np.array_equal(honest, first), "it learns while the sensor is right"
    assert abs(stage.feedforward_um(12.0) - 12.0) < 0.01 * RANGE_UM


@pytest.mark.parametrize("model", CLASSES)
@pytest.mark.parametrize("lie", NEAR)
@pytest.mark.few(3)
def test_lie_that_is_not_found_teaches_no_more_than_the_bound(model: str, lie: str) -> None:
    """It is told before it is at the bound; then learning goes on, and feedforward stays near."""
    stage = LyingStage(with_model(quick_config(), model))
    stage.run(3.0)
    before = stage.moved
    stage.lie(NEAR[lie])
    moved = [stage.moved for _ in range(22) if stage.run(1.0)]
    stage.lie(None)
    mode_after = stage.x.mode
    stage.to_safe()

    assert before < 0.5 * BOUND
    assert max(moved) <= 1.1 * BOUND
    assert stage.faults() == ["D11", "D5"]
    assert mode_after is Mode.ADAPTIVE
    assert abs(stage.feedforward_um(12.0) - 12.0) < BOUND * RANGE_UM


@pytest.mark.parametrize(("mode", "near"), [(Mode.TRIMMED, 0.01), (Mode.CLOSED, BOUND)])
def test_what_is_learned_below_a_feedback_is_bounded_too(mode: Mode, near: float) -> None:
    """It can be saved; in `trimmed` on a fixed model it does not act on the drive."""
    stage = LyingStage(quick_config(), mode)
    stage.lie(NEAR["0.9 times"])
    moved = [stage.moved for _ in range(15) if stage.run(1.0)]
    stage.lie(None)
    stage.to_safe()

    assert 0.8 * BOUND < max(moved) <= 1.1 * BOUND
    assert stage.faults() == ["D11", "D5"]
    assert abs(stage.feedforward_um(12.0) - 12.0) < near * RANGE_UM


def test_drift_of_a_sound_stage_is_learned_and_told() -> None:
    """A gain that has grown by 3 % is within the bound, and more than half of it."""
    stage = LyingStage(quick_config())
    stage.lie(lambda t_s, x_um: (1.0 + min(0.01 * t_s, 0.03)) * x_um)
    stage.run(16.0)
    errors_um = [each.axes[0].command_um - each.axes[0].position_um for each in stage.run(2.0)]

    assert np.max(np.abs(errors_um)) < 0.015 * RANGE_UM
    assert "D5" not in stage.faults()


def test_weights_of_a_lie_do_not_survive_a_change_of_the_mode() -> None:
    """They were taken over by feedforward before the fault said that the sensor lies."""
    stage = LyingStage(quick_config())
    stage.lie(NEAR["1.15 times"])
    stage.run(6.0)
    stage.do(rq.SelectMode(mode=Mode.FEEDFORWARD))
    stage.run(1.0)
    law = stage.stage.axes[0].law
    taught = law.compensator.weights.copy()
    stage.lie(FAR["1.4 times"])
    stage.run(4.0)
    stage.lie(None)
    stage.to_safe()
    stage.do(rq.Arm())
    stage.run(0.5)

    assert not np.allclose(taught, law.proof.first.weights)
    np.testing.assert_array_equal(law.compensator.weights, law.proof.first.weights)
    assert (law.compensator.offset, law.compensator.scale) == (0.0, 0.0)


@pytest.mark.parametrize("fault", DOUBTING)
@pytest.mark.few(5)
def test_each_fault_of_samples_that_were_wrong_drops_what_was_learned(fault: Fault) -> None:
    """Only on its axis, and until it ends nothing is learned."""
    axis = quick_config().axes["x"]
    assert axis.sensor is not None
    rig = quick_config().devices["rig"]
    config = quick_config().model_copy(
        update={
            "devices": {"rig": rig, "other": rig},
            "axes": {
                "x": axis,
                "y": axis.model_copy(
                    update={
                        "amplifier": axis.amplifier.model_copy(update={"device": "other"}),
                        "sensor": axis.sensor.model_copy(update={"device": "other"}),
                    }
                ),
            },
        }
    )
    stage = RigStage(config)
    stage.cycle()
    both = dict.fromkeys("xy", WAVE.command_um["x"])
    wave = rq.Wave(command_um=both, duration_s=100.0)
    stage.do(rq.Arm(), rq.SelectMode(mode=Mode.ADAPTIVE), wave)
    stage.run(3.0)
    x, y = (each.law for each in stage.stage.axes)
    learned = y.identifier.weights.copy()

    stage.controller.report(Detection(fault, 1))
    stage.cycle()

    assert not np.array_equal(learned, y.proof.first.weights)
    np.testing.assert_array_equal(y.identifier.weights, y.proof.first.weights)
    assert not np.array_equal(x.identifier.weights, x.proof.first.weights)
    assert (x.identifier.gate.doubted, y.identifier.gate.doubted) == (False, True)
