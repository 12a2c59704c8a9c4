"""What a running stage is driven with to identify it: from a file, or designed for its voltages."""

from pathlib import Path
from typing import Any, Final, NamedTuple

from piezod.config.combined_waveforms import Sequence, SequencePart, WaveformConfig
from piezod.config.document import Document
from piezod.config.experiment_fields import IdentificationConfig
from piezod.config.fields import ConfigModel, Context
from piezod.config.validate import validate
from piezod.config.waveforms import Points
from piezod.config.yaml_loader import load_yaml, parse_yaml
from piezod.control.reference.waveforms import build_waveform
from piezod.errors import ConfigError, Problem
from piezod.experiment.fit.excitation import recommended_drive
from piezod.experiment.live.setup import LiveAxis

KEY: Final = "identification"
_LEAST_STEP_V: Final = 1e-6


class LiveDrive(NamedTuple):
    """A drive that begins where a stage rests.

    Attributes:
        settle_s: Rest before it, in s.
        run_in_s: First part of it, which does not count, in s.
        duration_s: How long it is, in s.
        drive_v: Voltage over time, in V.
    """

    settle_s: float
    run_in_s: float
    duration_s: float
    drive_v: WaveformConfig


class _File(ConfigModel):
    identification: IdentificationConfig


def read_drive(path: Path) -> IdentificationConfig:
    """Read the `identification:` of a file, be it an experiment or that alone.

    Raises:
        ConfigError: If it cannot be read, has none, or one that is not valid.
    """
    document = load_yaml(path)
    if KEY not in document.data:
        what = f"there is no `{KEY}:`, as an experiment has it; it tells the drive"
        raise ConfigError(Problem(str(path), 0, 0, "", what))
    return _validated(document, path.parent)


def designed_drive(axis: LiveAxis) -> IdentificationConfig:
    """Return a drive that tells everything that a model needs, over all voltages of an axis."""
    limits = axis.config.limits
    text = recommended_drive(limits.drive_min_v, limits.drive_max_v)
    return _validated(parse_yaml(text, "designed drive"), Path())


def _validated(document: Document, folder: Path) -> IdentificationConfig:
    data: dict[str, Any] = {KEY: document.data[KEY]}
    only = Document(document.file, data, document.values, document.keys)
    return validate(only, _File, Context(folder)).identification


def from_rest(settings: IdentificationConfig, axis: LiveAxis) -> LiveDrive:
    """Return a drive with the way to its first voltage before it, at the rate of the safe ramp.

    Args:
        settings: The drive.
        axis: What is driven.
    """
    rest_v, rate_v_per_s = axis.config.limits.rest_v, axis.config.safety.ramp_v_per_s
    drive_v, duration_s = settings.drive_v, settings.duration_s
    first_v = build_waveform(drive_v, duration_s).value(0.0)
    if abs(first_v - rest_v) <= _LEAST_STEP_V:
        return LiveDrive(settings.settle_s, settings.run_in_s, duration_s, drive_v)
    way_s = max(abs(first_v - rest_v) / rate_v_per_s, axis.period_s)
    way = Points(kind="points", points=((0.0, rest_v), (way_s, first_v)))
    parts = (
        drive_v.parts
        if isinstance(drive_v, Sequence)
        else (SequencePart(duration_s=duration_s, waveform=drive_v),)
    )
    return LiveDrive(
        settings.settle_s,
        settings.run_in_s + way_s,
        duration_s + way_s,
        Sequence(kind="sequence", parts=(SequencePart(duration_s=way_s, waveform=way), *parts)),
    )
