"""The first phase of an experiment: a model for every axis, from a recording or from a file."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from piezod.config.axes import AxisConfig
from piezod.config.daemon import ConditioningConfig
from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import IdentificationConfig
from piezod.config.modes import Mode
from piezod.control.law.axis import TimeFunction
from piezod.control.law.compensated import in_loop
from piezod.control.law.dynamics import known_dynamics
from piezod.control.law.gains import LoopProperties, check_axis_gains, check_gains, prefix_errors
from piezod.control.law.model import StageModel, with_found_mode
from piezod.control.law.model_files import read_model
from piezod.control.reference.programs import conditioning
from piezod.errors import DataError
from piezod.experiment.fit.errors import judge
from piezod.experiment.fit.examination import examined
from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.fit_numbers import numbers_of_file, numbers_of_fit
from piezod.experiment.fit.method import Method, Spacing
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.uncertainty import uncertainty_of
from piezod.experiment.fit.warnings import (
    fit_warnings,
    mode_warnings,
    quality_warnings,
    trim_warnings,
)
from piezod.experiment.virtual.creeping import Creeping
from piezod.experiment.virtual.stage import IN_FORCE_V, POSITION_UM, VirtualStage
from piezod.hysteresis.memory import FloatArray
from piezod.records.experiment_result import Identification
from piezod.units import NS_PER_S


@dataclass(frozen=True)
class IdentifiedAxis:
    """An axis with its model."""

    #: Configuration of the axis, with the first mode of its model if it has none.
    config: AxisConfig
    model: StageModel  #: The model, with its zero at rest.
    creeping: Creeping  #: The creep of the axis so far.
    numbers: Identification  #: Origin of the model.
    warnings: tuple[str, ...]  #: Warnings for the user of the model.


def identify_axes(stage: VirtualStage, config: ExperimentConfig) -> Mapping[str, IdentifiedAxis]:
    """Return the model of every axis, in order; axes without a model file are identified.

    Raises:
        ConfigError: If a model file cannot be used.
        DataError: If the record cannot be used, or a model does not hold at the rest voltage.
        DeviceError: If a device refuses a voltage.
        ModelError: If a gain of an identifier or of a trim is not safe; the text names the axis.
    """
    period_s, trimmed = stage.period_ns / NS_PER_S, Mode.TRIMMED in config.modes
    check_gains(config.axes, period_s, config.modes)
    from_file = {
        name: _from_file(name, axis, axis.model, stage.period_ns)
        for name, axis in config.axes.items()
        if axis.model is not None
    }
    settings = config.identification
    if settings is None:
        _condition(stage, config.axes, from_file)
        return from_file
    # The rest zeroes the sensors, so that the record counts from rest.
    stage.rest(settings.settle_s)
    traces = _drive(stage, config.axes, settings)
    identified = {
        name: from_file.get(name)
        or _from_record(name, axis, _record(name, stage, traces[name]), settings, trimmed=trimmed)
        for name, axis in config.axes.items()
    }
    for name, one in identified.items():
        properties = LoopProperties(one.model.form, one.model.delay_s, period_s)
        check_axis_gains(name, one.config, properties, config.modes)
    return identified


def _condition(
    stage: VirtualStage, axes: Mapping[str, AxisConfig], identified: Mapping[str, IdentifiedAxis]
) -> None:
    """Condition axes that rest inside their range: where they have been before is not known."""
    inside = {
        name: conditioning(ConditioningConfig(), axis.limits)
        for name, axis in axes.items()
        if identified[name].model.rests_inside(axis.limits.rest_v)
    }
    if not inside:
        return
    waveforms = [
        inside[name].drive_v if name in inside else _constant(axis.limits.rest_v)
        for name, axis in axes.items()
    ]
    duration_s = max(program.duration_s for program in inside.values())
    for one, trace in zip(identified.values(), stage.open_loop(waveforms, duration_s), strict=True):
        one.creeping.watch(trace[:, POSITION_UM])
        one.creeping.follow(trace[:, IN_FORCE_V])


def _drive(
    stage: VirtualStage, axes: Mapping[str, AxisConfig], settings: IdentificationConfig
) -> Mapping[str, FloatArray]:
    """Drive the axes without a model while the others rest; return the trace of each axis."""
    drive = settings.drive_v.built(settings.duration_s).value
    waveforms = [
        drive if axis.model is None else _constant(axis.limits.rest_v) for axis in axes.values()
    ]
    traces = stage.open_loop(waveforms, settings.duration_s)
    return dict(zip(axes, traces, strict=True))


def _constant(drive_v: float) -> TimeFunction:
    return lambda _t_s: drive_v


def _record(name: str, stage: VirtualStage, trace: FloatArray) -> Record:
    position_um = trace[:, POSITION_UM]
    invalid = np.flatnonzero(~np.isfinite(position_um))
    t_s = np.arange(trace.shape[0], dtype=np.float64) * (stage.period_ns / NS_PER_S)
    if invalid.size:
        message = (
            f"axis {name}: {invalid.size} of {t_s.size} samples of the identification were "
            f"invalid, the first at {t_s[invalid[0]]:.3f} s; "
            "check that the sensor is in its range over the whole drive"
        )
        raise DataError(message)
    return Record(t_s, trace[:, IN_FORCE_V].copy(), position_um.copy())


def _from_record(
    name: str, axis: AxisConfig, record: Record, settings: IdentificationConfig, *, trimmed: bool
) -> IdentifiedAxis:
    compensator = axis.compensator
    with prefix_errors(name):
        # The fit counts samples after the run-in only.
        found = examined(
            record.after(settings.run_in_s), _known_delay_s(axis, record.period_s) or 0.0
        )
        record = found.record
        fit = fit_model(
            record,
            FitSettings(
                method=Method(settings.method),
                order=compensator.operators,
                spacing=Spacing(compensator.thresholds),
                creep=compensator.creep,
                lms_gain=compensator.lms_gain if compensator.identifier == "lms" else None,
                deadband=compensator.deadband_pct / 100.0,
                delay_s=_known_delay_s(axis, record.period_s),
            ),
        )
        model = fit.model.zeroed_at(axis.limits.rest_v)
        judged = judge(fit, record, None)
        doubts = [*found.notes, *quality_warnings(judged, record, None)]
        if fit.model.mode and (half := uncertainty_of(fit, judged.validation).mode):
            doubts += mode_warnings(fit.model.mode, half, axis.first_mode)
        if trimmed:
            doubts += trim_warnings(judged, axis.trim)
    title = "recorded run of the identification"
    numbers = numbers_of_fit(fit, record, judged.validation, axis=name, title=title)
    creeping = Creeping(model, axis.limits.rest_v, record.period_s)
    # The zero of the record is where the stage was at rest before it.
    creeping.watch(record.position_um + model.position_um.low - fit.model.position_um.low)
    creeping.follow(record.drive_v)
    return IdentifiedAxis(
        with_found_mode(axis, model),
        model,
        creeping,
        numbers,
        _for_axis(name, (*fit_warnings(fit, record.period_s), *doubts)),
    )


def _known_delay_s(axis: AxisConfig, period_s: float) -> float | None:
    """Return the delay of the configuration or of the response, in s; None if neither is known."""
    if axis.compensator.delay_s != "auto":
        return axis.compensator.delay_s
    dynamics = known_dynamics(axis, period_s)
    # A held voltage may act before its sample; the fits of stops know no such delay.
    return None if dynamics is None else max(dynamics.slow_delay_s, 0.0)


def _from_file(name: str, axis: AxisConfig, path: Path, period_ns: int) -> IdentifiedAxis:
    in_file, file = read_model(path)
    with prefix_errors(name):
        zeroed = in_file.zeroed_at(axis.limits.rest_v)
    model = in_loop(axis, zeroed, None, period_ns / NS_PER_S)
    numbers = numbers_of_file(file, model, axis=name, title=f"model file {path.name}")
    creeping = Creeping(model, axis.limits.rest_v, period_ns / NS_PER_S)
    return IdentifiedAxis(with_found_mode(axis, model), model, creeping, numbers, ())


def _for_axis(axis: str, warnings: Iterable[str]) -> tuple[str, ...]:
    return tuple(f"Axis {axis}: {warning}" for warning in warnings)
