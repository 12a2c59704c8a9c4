"""The stage of the lying amplifier, as a user would configure it."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Final

from tests.forked import run
from tests.liars.process import Speaks
from tests.liars.stage import Stage

RATE_HZ: Final = 50.0
SLEW_V_PER_S: Final = 200.0
RAMP_V_PER_S: Final = 100.0
SAFE_V: Final = 0.0
HIGHEST_V: Final = 150.0
TOLERANCE_V: Final = 0.75
"""0.5 % of the range, as docs/faults.md says."""

_TEXT: Final = r"""
rate_hz: {rate:g}
devices:
  amp:
    driver: {driver}
    options:
      port: {port}
      timeout_ms: 100
{options}
axes:
  x:
    amplifier: {{device: amp, channel: {output}}}
    sensor: {{device: amp, channel: {input}}}
    limits: {{drive_min_v: 0, drive_max_v: {highest:g}, slew_v_per_s: {slew:g}, rest_v: 0}}
    command_range_um: [0, 24]
    first_mode: {{frequency_hz: 400, damping: 0.05}}
    model: {model}
    compensator: {{identifier: rls, deadband_pct: 0.05, sensor_delay_s: 0}}
    trim: {{base: feedforward, gain_per_s: 5, authority_pct: 5}}
    speed_um_per_s: 30
    on_target: {{tolerance_um: 0.3, settle_s: 0.1}}
    safety: {{safe_v: {safe:g}, ramp_v_per_s: {ramp:g}}}
"""
_LINES: Final = r"""
      max_rate_hz: 500
      outputs: {V: {unit: V, lowest: -1, highest: 151}}
      inputs: {P: {unit: µm}}
      identify: {send: 'ID?', reply: '(?P<maker>\S+) (?P<model>\S+) (?P<serial>\S+)'}
      set: [{send: 'W {V:.4f}', reply: OK}]
      read: [{send: 'P?', reply: 'P (?P<P>-?\d+\.\d+)'}]
      read_back: [{send: 'V?', reply: 'V (?P<V>-?\d+\.\d+)'}]
      errors: [{pattern: BUSY, flag: busy}, {pattern: ERR, flag: wrong request}]
"""
_GCS: Final = """
      axes: ['1']
      range_v: [-1, 151]
      wave_end: holds
"""
_DEVICES: Final[Mapping[Speaks, Mapping[str, str]]] = {
    "lines": {"driver": "ascii", "options": _LINES, "output": "V", "input": "P"},
    "gcs": {"driver": "pi_gcs2", "options": _GCS, "output": "'1'", "input": "'1'"},
}
"""The device, and the names of its channels, by how the amplifier speaks."""


def configured(folder: Path, port: Path, model: Path, speaks: Speaks) -> Path:
    """Write the configuration; return its path."""
    path = folder / "liar.yaml"
    limits = {"highest": HIGHEST_V, "slew": SLEW_V_PER_S, "safe": SAFE_V, "ramp": RAMP_V_PER_S}
    text = _TEXT.format(rate=RATE_HZ, port=port, model=model, **limits, **_DEVICES[speaks])
    path.write_text(text, encoding="utf-8")
    return path


@cache
def identified(folder: Path) -> Path:
    """Record the stage, let `piezod identify` fit its model, and return the path of the model."""
    stage, rows = Stage(seed=2), ["t_s,drive_v,position_um"]
    for i in range(8000):
        turn, share = divmod(i / 1000, 1.0)
        height_v = 148.0 * max(1.0 - max(turn - 1.0, 0.0) / 7.0, 0.0)
        drive_v = height_v * (1.0 - abs(2.0 * share - 1.0))
        stage.drive(drive_v)
        rows.append(f"{i / 100.0:.2f},{drive_v:.5f},{stage.position_um():.5f}")
    record, model = folder / "record.csv", folder / "model.yaml"
    record.write_text("\n".join(rows) + "\n")
    done = run(["identify", str(record), "--order", "10", "--delay-s", "0", "--out", str(model)])
    assert done.returncode == 0, done.stderr
    return model
