"""A scan that the loop carries out, in virtual time."""

from collections.abc import Mapping

import numpy as np

from piezod.config.experiment import ExperimentConfig
from piezod.config.modes import SENSED, Mode
from piezod.config.scan import AnyScan
from piezod.config.waveforms.paths import Points
from piezod.control.law.compensated import Start, compensated_axis
from piezod.control.reference.motion import MotionLimits, lead_in, rest_at, waveform_motion
from piezod.errors import DataError
from piezod.experiment.scan.by_loop import Cycles, plan_by_loop, run_by_loop
from piezod.experiment.scan.loop_lines import PartLines
from piezod.experiment.scan.plan import PlannedAxis
from piezod.experiment.scan.run import ScanResult, ScanSetting, Told, planned_axis
from piezod.experiment.virtual.identify import IdentifiedAxis, identify_axes
from piezod.experiment.virtual.ringing import RingingWatch
from piezod.experiment.virtual.stage import (
    IN_FORCE_V,
    POSITION_UM,
    TRUE_UM,
    VirtualStage,
    opened,
)
from piezod.units import NS_PER_S

LEAD_IN_S = 0.5
"""Shortest time of the motion to the start of a part, in s; over the whole range it is twice."""


class VirtualLoopStage:
    """Implements `LoopStage` for a virtual stage.

    Args:
        stage: The stage.
        config: The experiment.
        identified: All axes, by name, in order.
        mode: Mode of all axes.
        scanned: What is known of the axes that are scanned, by name.
    """

    def __init__(
        self,
        stage: VirtualStage,
        config: ExperimentConfig,
        identified: Mapping[str, IdentifiedAxis],
        mode: Mode,
        scanned: Mapping[str, PlannedAxis],
    ) -> None:
        self._stage, self._config, self._mode = stage, config, mode
        self._identified, self._scanned = identified, scanned
        self._places = [tuple(identified).index(name) for name in scanned]
        self._at_um = dict.fromkeys(scanned, 0.0)

    def begin(self) -> None:
        """Rest, zero the sensors, and select the mode."""
        stage, identified = self._stage, self._identified
        rests = stage.rest(self._config.settle_s)
        for one, trace in zip(identified.values(), rests, strict=True):
            one.creeping.watch(trace[:, POSITION_UM])
            one.creeping.follow(trace[:, IN_FORCE_V])
            one.creeping.zero()
        ranges_um = {name: one.model.position_um for name, one in identified.items()}
        self._watch = RingingWatch("the scan", ranges_um, rests[:, :, POSITION_UM], stage.period_ns)
        self._axes = [
            compensated_axis(
                one.config,
                one.model,
                one.creeping.state,
                self._mode,
                rest_at(0.0).reference_um,
                Start(stage.now_ns, stage.period_ns, in_force_v),
            )
            for one, in_force_v in zip(identified.values(), stage.in_force_v, strict=True)
        ]

    def follow(
        self,
        waveforms_um: Mapping[str, Points],
        duration_s: float,
        lines: PartLines,  # noqa: ARG002 - asked for by LoopStage; there are none
    ) -> Cycles:
        """Go to the start of waveforms and follow them; return the cycles since their begin."""
        stage = self._stage
        built = {name: each.built(duration_s) for name, each in waveforms_um.items()}
        before = {
            name: lead_in(waveform, self._at_um[name], 0.0, self._limits(name))
            for name, waveform in built.items()
        }
        period_s = stage.period_ns / NS_PER_S
        longest_s = max(each.duration_s for each in before.values())
        begins_s = float(np.ceil(longest_s / period_s)) * period_s
        for place, (name, waveform) in zip(self._places, built.items(), strict=True):
            motion = waveform_motion(waveform, duration_s, before[name], begins_s)
            self._axes[place].follow(motion.reference_um, stage.now_ns)
            self._at_um[name] = motion.target_um
        after = self._watch.see if self._mode in SENSED else None
        stage.run(self._axes, begins_s, after=after)
        trace = stage.run(self._axes, duration_s, after=after)[self._places]
        t_s = np.arange(trace.shape[1], dtype=np.float64) * period_s
        return Cycles(
            t_s,
            np.tile(t_s[:, None], (1, len(trace))),
            trace[:, :, POSITION_UM].T,
            trace[:, :, TRUE_UM].T,
            np.zeros(t_s.size),
        )

    def _limits(self, name: str) -> MotionLimits:
        low_um, high_um = self._scanned[name].range_um
        return MotionLimits((high_um - low_um) / LEAD_IN_S, LEAD_IN_S, low_um, high_um)


def scan_by_virtual_loop(
    config: ExperimentConfig, scan: AnyScan, mode: Mode, setting: ScanSetting, told: Told
) -> ScanResult:
    """Carry out the scan of an experiment by the loop, in virtual time.

    Raises:
        ConfigError: If a model file cannot be used.
        DataError: If the scan does not fit an axis or the loop, before anything moves.
        DeviceError: If a device cannot be opened, or refuses a voltage.
        ModelError: If a gain is not safe, or an axis oscillates.
    """
    if scan.pulses.given or scan.waits:
        raise DataError(
            "scan: an experiment in virtual time has no lines of the loop: scan with --live, or "
            "leave out pulses and edges"
        )
    config = config.model_copy(update={"modes": (mode,)})
    with opened(config, lambda _: None) as stage:
        identified = identify_axes(stage, config)
        planned = {
            span.axis: planned_axis(identified[span.axis].config, identified[span.axis].model)
            for span in scan.spans
        }
        plan = plan_by_loop(scan, planned, stage.period_ns)
        configs = [config.axes[name] for name in plan.axes]
        on = VirtualLoopStage(stage, config, identified, mode, planned)
        return run_by_loop(scan, plan, configs, on, setting, told)
