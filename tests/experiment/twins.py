"""Two axes with the same stage: one rests at the end of its range, one inside."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.config.modes import Mode
from piezod.devices import registry
from piezod.experiment.virtual.run import run_experiment

RATE_HZ: Final = 500.0
UNIPOLAR: Final = (0.0, 140.0)
BIPOLAR: Final = (-20.0, 120.0)
"""Lowest and highest voltage; both rest at 0 V."""
RIG: Final = (
    "{variant: preisach-gaussian, amplifier: {output_min_v: -25}, effects: {creep: false, "
    "drift: false}, calibration: {kind: commissioned, residual_pct: 0.0}}"
)


@cache
def twin(low_v: float, high_v: float, method: str = "surface") -> ExperimentConfig:
    """Return an experiment with an axis of this range, which it identifies."""
    half_v, most_v = 0.5 * (low_v + high_v), low_v + 0.7 * (high_v - low_v)
    swing_v = 0.5 * (high_v - low_v)
    thresholds = "" if method == "surface" else "thresholds: graded, "
    text = f"""\
rate_hz: {RATE_HZ:g}
seed: 1
devices:
  rig: {{driver: simulated, options: {RIG}}}
axes:
  x:
    amplifier: rig
    sensor: rig
    limits: {{drive_min_v: {low_v}, drive_max_v: {high_v}, slew_v_per_s: 20000, rest_v: 0}}
    first_mode: {{frequency_hz: 734, damping: 0.03}}
    compensator: {{{thresholds}identifier: rls, sensor_delay_s: 0.00063}}
identification:
  method: {method}
  settle_s: 1
  run_in_s: 2
  duration_s: 15
  drive_v:
    kind: sequence
    parts:
      - {{duration_s: 2, waveform: {{kind: sine, low: {low_v}, high: {high_v}, frequency_hz: 1}}}}
      - duration_s: 5
        waveform:
          kind: sine
          low: {low_v}
          high: {high_v}
          frequency_hz: 1.4
          envelope: {{kind: decaying, time_constant_s: 2.5}}
      - duration_s: 7
        waveform:
          kind: sum
          parts:
            - {{kind: triangle, low: {low_v}, high: {half_v}, frequency_hz: 2}}
            - {{kind: triangle, low: 0, high: {swing_v}, frequency_hz: 0.3}}
      - {{duration_s: 1, waveform: {{kind: sine, low: {low_v}, high: {most_v}, frequency_hz: 5}}}}
modes: [feedforward]
metrics: [true_tracking_max_pct, true_tracking_rms_pct]
settle_s: 1.5
cases:
  - name: full
    period_s: 1
    duration_s: 3
    command_um: {{kind: sine, low: 0, high: 15, frequency_hz: 1}}
  - name: small
    period_s: 1
    duration_s: 3
    command_um: {{kind: triangle, low: 0, high: 6, frequency_hz: 1}}
  - name: middle
    period_s: 1
    duration_s: 3
    command_um: {{kind: sine, low: 0, high: 12, frequency_hz: 1, anchor: middle}}
"""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "twin.yaml"
        path.write_text(text, encoding="utf-8")
        return load_experiment(path, registry)


def errors_pct(config: ExperimentConfig, mode: Mode) -> list[float]:
    """Return the rms error of each case, in % of its range."""
    config = config.model_copy(update={"modes": (mode,)})
    result = run_experiment(config, "", "", lambda _label, _share: None)
    return [each.metrics["true_tracking_rms_pct"] for each in result.recordings]
