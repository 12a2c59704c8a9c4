"""Waveforms that a loop cannot make."""

from piezod.config.waveforms.shapes import Sine
from piezod.messages import requests
from tests.control.rig_stage import RigStage


def test_wave_above_half_of_the_rate_is_refused_before_it_moves() -> None:
    """Commands and drives from half of the rate on are refused with the limit; others are not."""
    stage = RigStage().armed()
    fast, slow = (Sine(kind="sine", low=0.0, high=5.0, frequency_hz=f) for f in (100.0, 99.9))

    refused = stage.ask(requests.Wave(command_um={"x": fast}, duration_s=1.0))
    assert (refused.accepted, stage.state) == (False, "READY")
    assert "too fast for the loop (got 100 Hz), allowed: below 100 Hz" in refused.why
    driven = stage.ask(requests.Identify(drive_v={"x": fast}, duration_s=1.0))
    assert (driven.accepted, stage.state) == (False, "READY")
    assert "too fast for the loop (got 100 Hz)" in driven.why
    assert stage.ask(requests.Wave(command_um={"x": slow}, duration_s=1.0)).accepted
