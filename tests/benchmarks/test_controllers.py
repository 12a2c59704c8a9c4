"""Tests of the plain controllers that the modes of piezod are compared with."""

from benchmarks.peers.controllers import CONTROLLERS, response_of, worst_of_controller
from piezod.dynamics.margins import refuse_unstable
from piezod.plant.variants import VARIANTS
from tests.experiment.beyond import brief, experiment_of


def test_gains_have_their_margins() -> None:
    """Also with little damping the gains pass the check of a trim."""
    plant = VARIANTS["light-damping"].parameters
    for controller in CONTROLLERS.values():
        period_s = 1.0 / controller.rate_hz
        stage = response_of(plant, period_s)

        assert refuse_unstable(controller.law(stage), period_s, stage).gain_margin >= 2.0


def test_fast_pi_with_notch_follows_better_than_a_slow_integral() -> None:
    """On the stack a sine of 0.5 Hz has less than half of the error."""
    config = brief(experiment_of("stack"))
    slow, fast = (worst_of_controller(each, config) for each in CONTROLLERS.values())

    assert fast < slow / 2.0
    assert slow < 5.0
