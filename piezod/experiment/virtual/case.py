"""One case of an experiment in one mode: from rest through the whole command."""

from collections.abc import Mapping

import numpy as np

from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import CaseConfig
from piezod.config.modes import SENSED, Mode
from piezod.config.waveforms.waveform import Waveform
from piezod.control.law.axis import CompensatedAxis
from piezod.control.law.compensated import Start, compensated_axis
from piezod.control.law.model import StageModel
from piezod.errors import DataError
from piezod.experiment.session.runs import RANGE_MARGIN, Run, with_errors
from piezod.experiment.virtual.identify import IdentifiedAxis
from piezod.experiment.virtual.ringing import RingingWatch
from piezod.experiment.virtual.stage import (
    COMMAND_UM,
    IN_FORCE_V,
    POSITION_UM,
    TRUE_UM,
    UNCOMPENSATED_V,
    VirtualStage,
)
from piezod.experiment.warnings import run_warnings
from piezod.hysteresis import ModelForm
from piezod.hysteresis.memory import FloatArray
from piezod.records.experiment_result import Recording
from piezod.units import NS_PER_S, s_to_ns

SNAPSHOT_S = 0.05
"""Interval at which the weights are recorded, in s."""


def run_case(
    stage: VirtualStage,
    config: ExperimentConfig,
    identified: Mapping[str, IdentifiedAxis],
    case: CaseConfig,
    mode: Mode,
) -> list[Run]:
    """Rest, run a case, and return one run per axis.

    Raises:
        DataError: If a command leaves the range in which the axis was identified.
        DeviceError: If a device refuses a voltage.
        ModelError: If an axis oscillates in a mode that needs the sensor.
    """
    references = {
        name: command.built(case.duration_s) for name, command in case.commands(config.axes).items()
    }
    for name, reference in references.items():
        _check_range(case, name, reference, identified[name].model)
    # The creep during the rest is part of the state at the start.
    rests = stage.rest(config.settle_s)
    rested_um = rests[:, :, POSITION_UM]
    for axis, trace in zip(identified.values(), rests, strict=True):
        axis.creeping.watch(trace[:, POSITION_UM])
        axis.creeping.follow(trace[:, IN_FORCE_V])
        axis.creeping.zero()
    axes = _axes(stage, config, identified, references, mode)
    forms = [axis.model.form for axis in identified.values()]
    snapshots = _Snapshots(axes, forms, every=max(1, s_to_ns(SNAPSHOT_S) // stage.period_ns))
    ranges_um = {name: axis.model.position_um for name, axis in identified.items()}
    watch = RingingWatch(f"{case.name}, {mode}", ranges_um, rested_um, stage.period_ns)
    after = watch.see if mode in SENSED else None
    traces = stage.run(axes, case.duration_s, before=snapshots.take, after=after)
    for name, trace in zip(config.axes, traces, strict=True):
        identified[name].creeping.watch(trace[:, POSITION_UM])
        identified[name].creeping.follow(trace[:, IN_FORCE_V])
    period_s = stage.period_ns / NS_PER_S
    recordings = [
        with_errors(recording, config.metrics, period_s)
        for recording in _recordings(config, case, mode, period_s, traces, snapshots)
    ]
    return [
        Run(recording, tuple(run_warnings(recording, _merged_pairs(axis))))
        for recording, axis in zip(recordings, axes, strict=True)
    ]


def _recordings(
    config: ExperimentConfig,
    case: CaseConfig,
    mode: Mode,
    period_s: float,
    traces: FloatArray,
    snapshots: "_Snapshots",
) -> list[Recording]:
    """Return the recordings of all axes, without errors, from (axes, n, columns) traces."""
    t_s = np.arange(traces.shape[1], dtype=np.float64) * period_s
    # Errors count after the first period, which starts from a relaxed stage.
    first = int(np.searchsorted(t_s, case.period_s))
    return [
        Recording(
            axis=name,
            case=case.name,
            mode=mode.value,
            title=case.title,
            t_s=t_s,
            drive_v=trace[:, IN_FORCE_V],
            position_um=trace[:, POSITION_UM],
            command_um=trace[:, COMMAND_UM],
            uncompensated_v=trace[:, UNCOMPENSATED_V],
            true_um=trace[:, TRUE_UM],
            weights=np.array(weights),
            weights_t_s=t_s[:: snapshots.every],
            surface=not form.two_sided,
            first_metric_index=first,
        )
        for name, trace, weights, form in zip(
            config.axes, traces, snapshots.weights, snapshots.forms, strict=True
        )
    ]


def _axes(
    stage: VirtualStage,
    config: ExperimentConfig,
    identified: Mapping[str, IdentifiedAxis],
    references: Mapping[str, Waveform],
    mode: Mode,
) -> list[CompensatedAxis]:
    """Return the axes at the start of a run."""
    return [
        compensated_axis(
            identified[name].config,
            identified[name].model,
            identified[name].creeping.state,
            mode,
            references[name].value,
            Start(stage.now_ns, stage.period_ns, in_force_v),
        )
        for name, in_force_v in zip(config.axes, stage.in_force_v, strict=True)
    ]


def _merged_pairs(axis: CompensatedAxis) -> int:
    return axis.compensator.merged_pairs + axis.identifier.merged_pairs


class _Snapshots:
    """The weights in use, in the order of a recording, at intervals."""

    def __init__(self, axes: list[CompensatedAxis], forms: list[ModelForm], every: int) -> None:
        self._axes, self.forms, self.every = axes, forms, every
        self.weights: list[list[FloatArray]] = [[] for _ in axes]

    def take(self, cycle: int) -> None:
        if cycle % self.every == 0:
            for axis, form, snapshots in zip(self._axes, self.forms, self.weights, strict=True):
                snapshots.append(form.as_recorded(axis.compensator.weights).copy())


def _check_range(case: CaseConfig, name: str, reference: Waveform, model: StageModel) -> None:
    identified = model.position_um
    margin = RANGE_MARGIN * identified.width
    if reference.low < identified.low - margin or reference.high > identified.high + margin:
        message = (
            f"{case.name} commands {reference.low:g} to {reference.high:g} µm, but axis {name} was "
            f"identified from {identified.low:.3g} to {identified.high:.3g} µm; reduce the "
            "command, or identify with a larger drive"
        )
        raise DataError(message)
