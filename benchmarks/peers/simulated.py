"""Records of the simulated rig: the identification of `beyond.yaml`, and another drive as test."""

import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.devices import registry
from piezod.experiment.fit.record import Record
from piezod.experiment.virtual.stage import IN_FORCE_V, POSITION_UM, opened
from piezod.hysteresis.memory import FloatArray
from piezod.plant.variants import VARIANTS
from piezod.units import NS_PER_S

BEYOND: Final = Path(__file__).parents[2] / "config" / "experiments" / "beyond.yaml"
FULL_V: Final = 150.0
"""Voltage of the full travel of the stage of `beyond.yaml`; drives of other stages are scaled."""
AVERAGED: Final = 3
"""Neighbouring samples that are averaged, as `piezod identify` averages long records."""
TEST: Final = """
method: least-squares
settle_s: 5
run_in_s: 8
duration_s: 48
drive_v:
  kind: sequence
  parts:
    - {duration_s: 8, waveform: {kind: sine, low: 0, high: 148, frequency_hz: 0.5}}
    - duration_s: 40
      waveform:
        kind: sum
        parts:
          - kind: multisine
            low: 0
            components:
              - {amplitude: 18, frequency_hz: 0.5}
              - {amplitude: 9, frequency_hz: 0.2236}
              - {amplitude: 5, frequency_hz: 0.8660}
          - kind: reversals
            low: 0
            high: 84
            min_swing: 20
            min_speed: 30
            max_speed: 150
            seed: 11
"""
"""The test, in the form of the identification of `beyond.yaml`; the run-in is the same."""
_VOLTAGES: Final = ("low", "high", "amplitude", "min_swing", "min_speed", "max_speed")


def simulated_records(variant: str) -> tuple[Record, Record]:
    """Return the record of the identification and that of the test of the same specimen.

    Args:
        variant: Name of the variant.
    """
    identification, test = experiments(variant)
    return _recorded(identification), _recorded(test)


def experiments(variant: str) -> tuple[ExperimentConfig, ExperimentConfig]:
    """Return `beyond.yaml` for a variant, and the same with the test as its identification.

    Args:
        variant: Name of the variant; all voltages are scaled to its full travel.
    """
    document = yaml.safe_load(BEYOND.read_text(encoding="utf-8"))
    return (
        _experiment(variant, document, document["identification"]),
        _experiment(variant, document, yaml.safe_load(TEST)),
    )


def _experiment(
    variant: str, document: dict[str, Any], identification: dict[str, Any]
) -> ExperimentConfig:
    full_v = VARIANTS[variant].parameters.stage.drive_v
    document["devices"]["rig"]["options"]["variant"] = variant
    lowest_v = VARIANTS[variant].lowest_v
    limits = {"drive_min_v": lowest_v, "drive_max_v": full_v}
    document["axes"]["x"]["limits"].update(limits)
    drive_v = _scaled(identification["drive_v"], (full_v - lowest_v) / FULL_V)
    if lowest_v:
        drive_v = _shifted(drive_v, lowest_v)
    document["identification"] = {**identification, "drive_v": drive_v}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "experiment.yaml"
        path.write_text(yaml.safe_dump(document), encoding="utf-8")
        return load_experiment(path, registry)


def _scaled(part: Any, factor: float) -> Any:
    """Return a waveform with its voltages times a factor."""
    if isinstance(part, list):
        return [_scaled(each, factor) for each in part]
    if isinstance(part, dict):
        return {
            name: factor * value if name in _VOLTAGES else _scaled(value, factor)
            for name, value in part.items()
        }
    return part


def _shifted(part: Any, by_v: float) -> Any:
    """Return a waveform that begins at another voltage; of a sum only one part is shifted."""
    if part["kind"] == "sequence":
        parts = [{**each, "waveform": _shifted(each["waveform"], by_v)} for each in part["parts"]]
        return {**part, "parts": parts}
    if part["kind"] == "sum":
        first, *others = part["parts"]
        return {**part, "parts": [_shifted(first, by_v), *others]}
    ends = {end: part[end] + by_v for end in ("low", "high") if end in part}
    return {**part, **ends}


def _recorded(config: ExperimentConfig) -> Record:
    """Drive the identification of an experiment from rest; return its averaged record."""
    settings = config.identification
    assert settings is not None  # noqa: S101 - for the type checker: it is in the document
    with opened(config, lambda _cycles: None) as stage:
        stage.rest(settings.settle_s)
        drive = settings.drive_v.built(settings.duration_s).value
        trace = stage.open_loop([drive], settings.duration_s)[0]
        t_s = np.arange(trace.shape[0]) * (stage.period_ns / NS_PER_S)
    return Record(
        _averaged(t_s), _averaged(trace[:, IN_FORCE_V]), _averaged(trace[:, POSITION_UM])
    ).after(settings.run_in_s)


def _averaged(values: FloatArray) -> FloatArray:
    whole = values[: values.size // AVERAGED * AVERAGED]
    return np.asarray(np.mean(whole.reshape(-1, AVERAGED), axis=1))
