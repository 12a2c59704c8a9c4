"""The drive that identifies a running stage: from a file, or designed for its voltages."""

from pathlib import Path
from typing import Any, Final, NamedTuple

from piezod.config.document import Document
from piezod.config.experiment_fields import IdentificationConfig
from piezod.config.fields import ConfigModel, Context
from piezod.config.validate import validate
from piezod.config.waveforms.combined import Sequence, SequencePart, WaveformConfig
from piezod.config.waveforms.paths import Points
from piezod.config.yaml_loader import load_yaml, parse_yaml
from piezod.errors import ConfigError, Problem
from piezod.experiment.fit.excitation import recommended_drive
from piezod.experiment.live.setup import LiveAxis

KEY: Final = "identification"
_SAME_V: Final = 1e-6


class LiveDrive(NamedTuple):
    """A drive that starts at the rest voltage."""

    settle_s: float  #: Rest before it, in s.
    run_in_s: float  #: First part of it, which does not count, in s.
    duration_s: float  #: Its duration, in s.
    drive_v: WaveformConfig  #: Voltage over time, in V.


class _File(ConfigModel):
    identification: IdentificationConfig


def read_drive(path: Path) -> IdentificationConfig:
    """Read the `identification:` of a file: an experiment, or a file with that key alone.

    Raises:
        ConfigError: If the file cannot be read, or has no valid identification.
    """
    document = load_yaml(path)
    if KEY not in document.data:
        what = f"there is no `{KEY}:`, as in an experiment; it describes the drive"
        raise ConfigError(Problem(str(path), 0, 0, "", what))
    return _validated(document, path.parent)


def designed_drive(axis: LiveAxis) -> IdentificationConfig:
    """Return a drive with all excitation that a model needs, over all voltages of an axis."""
    limits = axis.config.limits
    text = recommended_drive(limits.drive_min_v, limits.drive_max_v, limits.slew_v_per_s)
    return _validated(parse_yaml(text, "designed drive"), Path())


def _validated(document: Document, folder: Path) -> IdentificationConfig:
    data: dict[str, Any] = {KEY: document.data[KEY]}
    only = Document(document.file, data, document.values, document.keys)
    return validate(only, _File, Context(folder)).identification


def from_rest(settings: IdentificationConfig, axis: LiveAxis) -> LiveDrive:
    """Return a drive with a ramp to its first voltage before it, at the rate of the safe ramp."""
    rest_v, rate_v_per_s = axis.config.limits.rest_v, axis.config.safety.ramp_v_per_s
    drive_v, duration_s = settings.drive_v, settings.duration_s
    first_v = drive_v.built(duration_s).value(0.0)
    if abs(first_v - rest_v) <= _SAME_V:
        return LiveDrive(settings.settle_s, settings.run_in_s, duration_s, drive_v)
    ramp_s = max(abs(first_v - rest_v) / rate_v_per_s, axis.period_s)
    ramp = Points(kind="points", points=((0.0, rest_v), (ramp_s, first_v)))
    # A sequence cannot contain a sequence, so the ramp becomes its first part.
    parts = (
        drive_v.parts
        if isinstance(drive_v, Sequence)
        else (SequencePart(duration_s=duration_s, waveform=drive_v),)
    )
    return LiveDrive(
        settings.settle_s,
        settings.run_in_s + ramp_s,
        duration_s + ramp_s,
        Sequence(kind="sequence", parts=(SequencePart(duration_s=ramp_s, waveform=ramp), *parts)),
    )
