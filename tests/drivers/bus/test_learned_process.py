"""Fast waveforms are learned on a device in another process, whatever the time of this one."""

from pathlib import Path

import pytest

from piezod.config.daemon import load_daemon
from piezod.config.fields import Context
from piezod.config.play import WaveConfig
from piezod.devices import registry
from piezod.experiment.play.axis import PlayingAxis
from piezod.experiment.play.command import command_of
from piezod.experiment.play.learn import learn
from piezod.experiment.play.response import MultisineSettings
from piezod.experiment.play.task import PlaySettings
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.gcs import dialogue
from tests.conftest import Figure
from tests.drivers.bus.distant_axis import distant_axis
from tests.drivers.bus.test_plays import LABJACK, PI_TCP, Player
from tests.experiment.play.rig_axis import model

RIG = """
rate_hz: 500
seed: 1
devices:
  rig:
    driver: simulated
    options:
      amplifier: {current_limit_a: 1, slew_v_per_s: 300000, capacitance_uf: 3}
      sensor: {antialias_hz: 5000, bandwidth_hz: 10000, delay_s: 0.00011}
      calibration: {kind: commissioned, residual_pct: 0.02} # as fast.yaml has it
axes:
  x:
    amplifier: rig
    sensor: rig
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 250000, rest_v: 0}
    command_range_um: [0, 30]
    compensator: {sensor_delay_s: 0.000171}
"""
SETTINGS = PlaySettings(passes=6, settle_s=5.0, record_s=1.0)
"""If only 1 s comes before the record, the stage creeps within it."""
PI = PI_TCP._replace(options={**PI_TCP.options, "wave_end": "holds"})


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait longer for replies: an emulator on a busy computer is slower than a controller."""
    monkeypatch.setattr(dialogue, "OPENING_NS", 10 * NS_PER_S)


def wave_of(kind: str, frequency_hz: float) -> WaveConfig:
    """Return a waveform over 80 % of the travel."""
    command_um = {"kind": kind, "low": 3.0, "high": 28.6, "frequency_hz": frequency_hz}
    data = {"name": f"{kind} {frequency_hz:g} Hz", "command_um": command_um}
    return WaveConfig.model_validate(data, context=Context())


@pytest.mark.stress
@pytest.mark.parametrize(
    ("player", "interval_us"), [(LABJACK, 100), (PI, 50)], ids=["labjack-t7", "pi-gcs2-tcp"]
)
def test_fast_waveforms_are_learned_over_a_bus(
    player: Player, interval_us: int, tmp_path: Path, figure: Figure
) -> None:
    """The true error is at most 0.2 % of the swing, at worst, after six passes.

    The sensor is that of `fast.yaml`, and the response is measured. A LabJack has memory for the
    multisine with the longer interval only.
    """
    interval_ns = 1000 * interval_us
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG, encoding="utf-8")
    config = load_daemon(rig, registry).axes["x"]
    with distant_axis(player, rig) as distant:
        axis = PlayingAxis.at_rest(distant, "x", config, model(), interval_ns)
        known = axis.known(MultisineSettings(interval_ns, 10.0, 3000.0, 0.03))
        plays = [
            learn(axis.stage, known.task(command_of(wave, interval_ns), SETTINGS), lambda _: None)
            for wave in (wave_of("sine", 200.0), wave_of("triangle", 100.0))
        ]
    for play in plays:
        before, best = play.reports[0].true, play.best
        figure(
            f"{player.profile}, {play.given.name}: true error in % of the swing, worst: "
            f"{before.max_pct:.2f} without learning, {best.true.max_pct:.3f} after {best.label}; "
            f"calibration {best.limit.calibration_pct:.3f}, apart {best.limit.apart_pct:.3f}"
        )
    assert max(play.best.true.max_pct for play in plays) <= 0.2
