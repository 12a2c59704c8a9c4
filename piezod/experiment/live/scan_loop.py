"""A scan that the loop of a running stage carries out, recorded by its daemon."""

from collections.abc import Mapping, Sequence

import numpy as np

from piezod.client import StageClient
from piezod.config.modes import Mode
from piezod.config.scan import AnyScan
from piezod.config.waveforms.paths import Points
from piezod.config.waveforms.shapes import Setpoint
from piezod.errors import DataError
from piezod.experiment.live.record import check_followed
from piezod.experiment.live.setup import LiveSetup
from piezod.experiment.live.stage import LiveStage
from piezod.experiment.scan.by_loop import Cycles, plan_by_loop, run_by_loop
from piezod.experiment.scan.loop_lines import PartLines, check_lines, count_pulses, followed
from piezod.experiment.scan.plan import PlannedAxis
from piezod.experiment.scan.run import ScanResult, ScanSetting, Told
from piezod.records.recording.reader import RecordedTelemetry
from piezod.units import NS_PER_S

WAIT_S = 0.1
"""Time at the start of a part before it is recorded, in s."""
REST_S = 1.0
"""Rest before the scan, in s."""


class RunningLoopStage:
    """Implements `LoopStage` for axes of a running stage.

    Args:
        stage: The stage.
        mode: Mode of the axes.
        axes: Their names.
        lines: Names of the lines of the stage, in the order of their bits.
    """

    def __init__(
        self, stage: LiveStage, mode: Mode, axes: tuple[str, ...], lines: Sequence[str] = ()
    ) -> None:
        self._stage, self._mode, self._axes, self._lines = stage, mode, axes, lines

    def begin(self) -> None:
        """Rest, zero the sensors, arm, and select the mode."""
        stage = self._stage
        stage.disarm()
        stage.select(self._mode, self._axes)
        stage.rest(REST_S)
        stage.arm()
        stage.select(self._mode, self._axes)

    def follow(
        self, waveforms_um: Mapping[str, Points], duration_s: float, lines: PartLines
    ) -> Cycles:
        """Go to the start of waveforms and follow them; return the cycles since their begin."""
        stage = self._stage
        # Axes that are there begin together: each would begin after its own way otherwise.
        begins_um = {
            name: Setpoint(kind="setpoint", level=each.points[0][1])
            for name, each in waveforms_um.items()
        }
        stage.follow(begins_um, WAIT_S, self._mode)
        # The recording starts before the movement, because its start is found in the recording.
        stage.recorder.start("scan")
        stage.follow(waveforms_um, duration_s, self._mode, lines)
        return _cycles(stage.recorder.end(), waveforms_um, duration_s, lines, self._lines)


def _cycles(
    telemetry: RecordedTelemetry,
    waveforms_um: Mapping[str, Points],
    duration_s: float,
    lines: PartLines,
    names: Sequence[str],
) -> Cycles:
    """Return the cycles of waveforms that were the last movement of a recording.

    Times in which it waited for an edge are left out; the same clock as in the loop finds them.

    Raises:
        DataError: If they were not commanded as given, from their start to their end.
    """
    axes = {name: telemetry.axes[name] for name in waveforms_um}
    motion = next(iter(axes.values()))["motion"]
    moved = int(np.searchsorted(motion, motion[-1]))
    if not moved:
        raise DataError("the recording of the scan does not start before the movement")
    # A request is carried out at the end of a cycle, with the time of that cycle.
    part, t_ns = slice(moved - 1, None), telemetry.cycles["t_ns"][moved - 1 :]
    masks = telemetry.cycles["lines"][part] if names else np.zeros(t_ns.size, np.int64)
    high = 0 if lines.edges is None else masks >> names.index(lines.edges.line) & 1
    moment = followed(lines.edges, t_ns - t_ns[0], high)
    since_s = moment.t_s
    if since_s[-1] < duration_s - 2.0 / telemetry.header.rate_hz and not moment.ended:
        raise DataError("the recording of the scan ends before it")
    for name, columns in axes.items():
        value = waveforms_um[name].built(duration_s).value
        check_followed(name, value, since_s[1:], columns["command_um"][part][1:])
    moves = np.diff(since_s, prepend=-1.0) > 0.0
    position_um, sample_ns = (
        np.stack([columns[column][part][moves] for columns in axes.values()], axis=1)
        for column in ("position_um", "sample_ns")
    )
    age_s = (t_ns[moves][:, None] - sample_ns) / NS_PER_S
    return Cycles(
        since_s[moves],
        since_s[moves][:, None] - age_s,
        position_um,
        np.full(position_um.shape, np.nan),
        telemetry.cycles["late_ns"][part][moves],
        moment.edges,
        moment.ended,
        count_pulses(masks, names),
    )


def scan_by_running_loop(
    client: StageClient,
    setup: LiveSetup,
    scan: AnyScan,
    mode: Mode,
    planned: Mapping[str, PlannedAxis],
    setting: ScanSetting,
    told: Told,
) -> ScanResult:
    """Carry out a scan by the loop of a running stage, and disarm the stage at the end.

    Args:
        client: A connection to the daemon of the stage.
        setup: Its setup.
        scan: The scan.
        mode: Mode of its axes.
        planned: What is known of them, by name.
        setting: How it is run.
        told: Who is told what.

    Raises:
        ClientError: If a request is refused, or the stage leaves the expected states.
        DataError: If the scan does not fit the stage, before anything moves; or if a record cannot
            be used.
        OSError: If the file cannot be written.
    """
    lines = setup.document.get("lines", {})
    check_lines(scan, lines, setup.user_axes)
    plan = plan_by_loop(scan, planned, round(NS_PER_S / setup.rate_hz))
    configs = [setup.axes[setup.moved_by(name)[0]].config for name in plan.axes]
    with LiveStage(client, setup, lambda _over_s: None) as stage:
        on = RunningLoopStage(stage, mode, plan.axes, tuple(lines))
        result = run_by_loop(scan, plan, configs, on, setting, told)
        stage.disarm()
    for note in stage.fault_notes("During the scan faults"):
        told.note(note)
    return result
