"""Checks whether a file of any kind can be used."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Final, NamedTuple

from piezod.config.axes import AxisConfig
from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.config.hung import reply_warnings
from piezod.config.model_file import ModelFile, load_model
from piezod.config.modes import CORRECTED, Mode
from piezod.config.response_file import ResponseFile, load_response
from piezod.config.yaml_loader import load_yaml
from piezod.control.assembly import check_stage, stage_warnings
from piezod.control.law.compensated import in_loop
from piezod.control.law.gains import check_gains
from piezod.control.law.learned_share import learned_share
from piezod.control.law.model import unidentified_form, with_found_mode
from piezod.control.law.model_files import read_model
from piezod.control.law.pace import slowest_unknown_mode_hz
from piezod.control.law.trim_gains import margins_text, slowest_untold_mode_hz
from piezod.devices import registry
from piezod.errors import ConfigError, DataError, ModelError, Problem
from piezod.experiment.warnings import rate_warnings
from piezod.messages.groups import GroupsFile, load_groups
from piezod.service_view import SERVICES, who_may_change, why_hidden

_EXPERIMENT_KEYS: Final = ExperimentConfig.model_fields.keys() - DaemonConfig.model_fields.keys()
_RESPONSE_KEYS: Final = (
    ResponseFile.model_fields.keys()
    - ModelFile.model_fields.keys()
    - ExperimentConfig.model_fields.keys()
)
_ASSUMED_DAMPING: Final = 0.01
"""Damping ratio of a first mode that nobody knows: of stages without a load, a small one."""


class FileKind(StrEnum):
    """Kind of a file."""

    EXPERIMENT = "experiment"
    STAGE = "stage"
    MODEL = "model"
    RESPONSE = "response"
    GROUPS = "groups"


class Checked(NamedTuple):
    """Result of the check of a file."""

    kind: FileKind | None  #: Kind of the file, None if its content does not show it.
    contents: str  #: Summary of its content, for people; empty if something is wrong.
    error: ConfigError | None  #: All problems, None for a file that can be used.
    warnings: tuple[str, ...] = ()  #: Reservations about a file that can be used.
    #: Margins of the trim of each axis with a response, and the gains proposed for it.
    margins: tuple[str, ...] = ()


def check_file(path: Path) -> Checked:
    """Find the kind of a file by its keys, and validate it with the files that it names."""
    kind = None
    try:
        kind = _kind(path)
        described = _DESCRIBE[kind](path)
    except ConfigError as error:
        return Checked(kind, "", error)
    warnings = (*described.warnings, *_open_files(path, described.named))
    return Checked(kind, described.contents, None, warnings, described.margins)


def _open_files(path: Path, named: Iterable[str]) -> Iterator[str]:
    """Yield what to know about the places of a file and of those that it names."""
    files = [path, *map(Path, named)]
    yield from dict.fromkeys(each for file in files for each in who_may_change(file))
    if SERVICES in path.absolute().parents:
        yield from (f"{file}: {why}" for file in files if (why := why_hidden(file.absolute())))


class _Description(NamedTuple):
    """Summary of a file, its warnings, the margins in it, and the files that it names."""

    contents: str
    warnings: tuple[str, ...] = ()
    margins: tuple[str, ...] = ()
    named: tuple[str, ...] = ()


def _kind(path: Path) -> FileKind:
    keys = load_yaml(path).data.keys()
    if keys == GroupsFile.model_fields.keys():
        return FileKind.GROUPS
    experiment_keys = len(keys & ExperimentConfig.model_fields.keys())
    model_keys = len(keys & (ModelFile.model_fields.keys() | _RESPONSE_KEYS))
    if experiment_keys == model_keys:
        what = (
            "not a stage, experiment, model or response; allowed are stages, with keys such as "
            "`devices` and `axes`, experiments, which have `cases`, too, models, with keys such as "
            "`format`, `method`, `fit`, responses, with keys such as `delay_s`, `resonances`, and "
            "groups of stages, with the key `groups`"
        )
        raise ConfigError(Problem(str(path), 0, 0, "", what))
    if model_keys > experiment_keys:
        return FileKind.RESPONSE if keys & _RESPONSE_KEYS else FileKind.MODEL
    return FileKind.EXPERIMENT if keys & _EXPERIMENT_KEYS else FileKind.STAGE


def _describe_experiment(path: Path) -> _Description:
    config = load_experiment(path, registry)
    try:
        check_gains(config.axes, 1.0 / config.rate_hz, config.modes)
    except ModelError as error:
        raise ConfigError(Problem(str(path), 0, 0, "", str(error))) from error
    axes = _count(len(config.axes), "axis", "axes")
    if config.play is not None:
        waves = _count(len(config.play.waves), "waveform")
        return _Description(f"an experiment: {waves} played on {axes}")
    if config.scan is not None:
        return _Description(f"an experiment: a {config.scan.kind} scanned on {axes}")
    cases, modes = _count(len(config.cases), "case"), _count(len(config.modes), "mode")
    contents = f"an experiment: {cases} in {modes} on {axes}"
    return _Description(
        contents,
        (
            *rate_warnings(config, config.rate_hz),
            # An identification may find the mode for learning; a trim is checked before.
            *_unknown_modes(config.axes, config.rate_hz, {*config.modes} & {Mode.TRIMMED}),
        ),
        _margins(config.axes, config.rate_hz),
    )


def _describe_stage(path: Path) -> _Description:
    named: dict[str, str] = {}
    config = load_daemon(path, registry, named)
    try:
        check_stage(config)
    except (DataError, ModelError) as error:
        raise ConfigError(Problem(str(path), 0, 0, "", str(error))) from error
    axes = _count(len(config.axes), "axis", "axes")
    blind = ", ".join(name for name, axis in config.axes.items() if axis.sensor is None)
    without = f"; {blind} without a sensor" if blind else ""
    contents = f"a stage: {axes} at {config.rate_hz:g} Hz{without}"
    warnings = (
        *stage_warnings(config),
        *reply_warnings(config),
        *_without_model(config.axes),
        *_of_unknown_rate(config.axes),
        *_unknown_modes(config.axes, config.rate_hz, tuple(Mode)),
    )
    return _Description(contents, warnings, _margins(config.axes, config.rate_hz), tuple(named))


def _without_model(axes: Mapping[str, AxisConfig]) -> tuple[str, ...]:
    """Return a warning for each axis that starts uncompensated."""
    warnings = []
    for name, axis in axes.items():
        if axis.model is not None:
            continue
        borrow = "" if axis.sensor is not None else "borrow a sensor, "
        warnings.append(
            f"axis {name}: it has no `model`. Its drive is proportional to the command, as in "
            "`uncompensated`, until a model has been identified and adopted. To have one at each "
            f"start, {borrow}run `piezod identify --live --out MODEL.yaml` on the running stage, "
            "and name the file as `model`, relative to this one"
        )
    return tuple(warnings)


def _of_unknown_rate(axes: Mapping[str, AxisConfig]) -> Iterator[str]:
    """Yield a warning for each axis whose model may have been identified at another rate."""
    for name, axis in axes.items():
        if axis.model is None:
            continue
        file = load_model(axis.model)
        if file.held_s is None:
            yield (
                f"axis {name}: its model file is of version {file.version} and does not tell the "
                "rate at which the stage was identified: its delay is right at that rate only. "
                "Identify again, or write `version: 3` and `held_s`, the period of the loop that "
                f"drove the stage, in s, into {axis.model.name}"
            )


def _unknown_modes(
    axes: Mapping[str, AxisConfig], rate_hz: float, modes: Collection[Mode]
) -> Iterator[str]:
    """Yield a warning for each axis whose sensor acts on it, and whose first mode is unknown."""
    for name, axis in axes.items():
        model = read_model(axis.model)[0] if axis.model else None
        told = with_found_mode(axis, model).first_mode is not None or axis.response is not None
        if axis.sensor is None or told:
            continue
        period_s, slow_hz = 1.0 / rate_hz, dict[Mode, float]()
        if Mode.ADAPTIVE in modes:
            form = model.form if model is not None else unidentified_form(axis)
            share = learned_share(axis.compensator, form)
            slow_hz[Mode.ADAPTIVE] = slowest_unknown_mode_hz(period_s, _ASSUMED_DAMPING, share)
        if Mode.TRIMMED in modes:
            delay_s = in_loop(axis, model, None, period_s).delay_s if model is not None else 0.0
            slow_hz[Mode.TRIMMED] = slowest_untold_mode_hz(
                Mode.TRIMMED, axis, period_s, delay_s, _ASSUMED_DAMPING
            )
        may = ", ".join(f"in `{mode}` below {hz:.2g} Hz" for mode, hz in slow_hz.items())
        if may:
            yield (
                f"axis {name}: neither `first_mode` nor `response` nor the model tells its first "
                f"mode. A mode with a damping of {_ASSUMED_DAMPING:g} may oscillate {may}. Measure "
                "it with `piezod response`, or take it from the data sheet"
            )


def _margins(axes: Mapping[str, AxisConfig], rate_hz: float) -> tuple[str, ...]:
    return tuple(
        f"axis {name}: {margins_text(mode, axis, 1.0 / rate_hz, 0.0)}"
        for name, axis in axes.items()
        if axis.response is not None and axis.sensor is not None
        for mode in CORRECTED
    )


def _describe_model(path: Path) -> _Description:
    _, file = read_model(path)
    return _Description(f"a model: {file.operators}, by {file.method}")


def _describe_response(path: Path) -> _Description:
    file = load_response(path)
    modes = _count(len(file.resonances), "resonance")
    delay_ms = 1e3 * file.delay_s
    return _Description(f"a response: {modes}, delay {delay_ms:.3g} ms, by {file.method}")


def _describe_groups(path: Path) -> _Description:
    groups = load_groups(path)
    stages = _count(len({stage for each in groups.values() for stage in each}), "stage")
    return _Description(f"groups of stages: {_count(len(groups), 'group')} of {stages}")


_DESCRIBE: Final = {
    FileKind.EXPERIMENT: _describe_experiment,
    FileKind.STAGE: _describe_stage,
    FileKind.MODEL: _describe_model,
    FileKind.RESPONSE: _describe_response,
    FileKind.GROUPS: _describe_groups,
}


def _count(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"
