"""Watches a stage for a day: limits, states, faults, errors, memory and files."""

import os
import sys
import threading
from collections import Counter
from math import isfinite, nan, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.faults.table import FAULTS, FaultSource, Reaction, ids
from piezod.control.law.learned_models import ModelDrift
from piezod.control.law.model import StageModel
from piezod.hysteresis import LearnedModel
from piezod.telemetry.learned import LearnedAxis
from piezod.telemetry.record import CycleRecord
from piezod.units import NS_PER_S
from tests.control.judged_device import JudgedDevice

MOST_VIOLATIONS = 100
ROW_NS = 60 * NS_PER_S
AFTER_S = 30.0
"""Time after a disturbance in which its faults may still appear and errors do not count, in s."""
LEARNED_PCT = 6.0
"""Largest distance of the learned model from the identified one. The bound of the stage is 5 %;
between two looks the model may be a little farther."""
JUDGED_NS = 5 * NS_PER_S
"""Motion after a disturbance in which errors do not count either, in ns: at rest nothing shows what
a faulty sensor has taught, and D1 judges each second of motion."""
LEARNED_NS = 300 * NS_PER_S
"""Motion after a disturbance in which faults of the adaptation may appear, in ns: what a fault has
taught, or has done to the hysteresis memory, ends in motion, so that D1 may come again after a rest
and a reset."""
MOVES_FROM = frozenset({State.READY, State.RUN, State.IDENT, State.HOLD})
"""States from which a stage may begin to move."""
STOPS = frozenset({State.HOLD, State.RAMP, State.BLIND, State.FAULT, State.ESTOP, State.STOPPING})
"""States that need a request or a fault."""


def _mask(least: Reaction) -> int:
    return sum(1 << i for i, rule in enumerate(FAULTS) if rule.reaction >= least)


STOPPING, DEGRADING = _mask(Reaction.HOLD), _mask(Reaction.DEGRADE)
OF_ADAPTATION = frozenset(rule.id for rule in FAULTS if rule.source is FaultSource.ADAPTATION)


class Row(NamedTuple):
    """One simulated minute."""

    hour: float  #: Its end, in simulated hours.
    rss_mb: float  #: Resident memory of the process.
    descriptors: int  #: Open file descriptors.
    threads: int  #: Threads of the process.
    files: int  #: Files of the stage.
    files_mb: float  #: Their size.
    blocks: int  #: Allocated blocks of the interpreter.
    #: Largest difference between the drives that the learned model and the identified one request
    #: along the widest loop, in % of the drive's range: the value of D5.
    drift_pct: float
    #: Error in mode adaptive while the stage moves and nothing is disturbed, root mean square, in %
    #: of the range. A minute with less than half a minute of such cycles has NaN; they count in the
    #: next one.
    error_rms_pct: float
    error_max_pct: float  #: Largest such error, in %.
    run_share: float  #: Share of the cycles in RUN.
    faults: int  #: Faults that appeared since the start.
    daemons: int  #: Daemons since the start.
    output_faults: int  #: Injected faults of output and read-back since the start.
    piezod_step_v: float  #: Largest distance of a write from the output since the start, in V.
    amplifier_step_v: float  #: Largest step of the output by itself since the start, in V.


class Observer:
    """Takes the record of each cycle."""

    def __init__(self, range_um: float, folder: Path, model: StageModel) -> None:
        self._range_um, self._folder = range_um, folder
        self.rows: list[Row] = []
        self.violations: list[str] = []
        self.states: Counter[State] = Counter()
        """Cycles in each state."""
        self.seen: Counter[Fault] = Counter()
        """How often each fault appeared."""
        self.cycles = self.daemons = self.output_faults = 0
        self.device: JudgedDevice | None = None
        """The device, whose steps the rows have."""
        self.drift_pct = nan
        self._model = model
        self._state: State | None = None
        self._present = 0
        self._disturbed_ns = self._calm_ns = 0
        self._asked: dict[State | Fault, int] = {}
        self._moved_ns = self._judged_ns = 0  # in RUN, the command moving
        self._taught: dict[Fault, int] = {}
        self._now_ns = self._row_ns = self._began_ns = 0
        self._command_um = nan
        self._sum = self._largest = 0.0
        self._counted = self._row_cycles = self._row_runs = 0

    def new_daemon(self) -> None:
        """Expect a daemon that starts."""
        self.daemons += 1
        self._state, self._present = None, 0

    def asked(self, *expected: State | Fault, within_s: float = 5.0) -> None:
        """Expect states and faults because of a request."""
        for each in expected:
            self._asked[each] = self._now_ns + int(within_s * NS_PER_S)

    def disturbed(self, until_ns: int) -> None:
        """Expect faults until some time after this instant."""
        self._disturbed_ns = max(self._disturbed_ns, until_ns)
        self._calm_ns = self._disturbed_ns + int(AFTER_S * NS_PER_S)
        self._expect_learning()

    def taught(self, *faults: Fault) -> None:
        """Expect faults of the adaptation until the stage has moved for some time."""
        for fault in faults:
            self._taught[fault] = self._moved_ns + LEARNED_NS

    def _expect_learning(self) -> None:
        self.taught(*OF_ADAPTATION)
        self._judged_ns = self._moved_ns + JUDGED_NS

    def learned(self, learned: LearnedAxis) -> None:
        """Compare what was learned with the identified model."""
        model = LearnedModel(np.array(learned.weights), learned.offset, learned.scale)
        self.drift_pct = 100.0 * ModelDrift(self._model).measure(model)

    def take(self, record: CycleRecord) -> None:
        """Judge a cycle."""
        passed_ns = record.t_ns - self._now_ns
        self._now_ns = now_ns = record.t_ns
        state = record.state
        self.cycles += 1
        self._row_cycles += 1
        self.states[state] += 1
        if state is not self._state:
            self._judge_state(record)
            self._state = state
        if record.present != self._present:
            self._judge_faults(record)
            self._present = record.present
        if state is State.RUN:
            self._row_runs += 1
            axis = record.axes[0]
            # At rest nothing is learned, and the creep of the last movement remains.
            moves = axis.command_um != self._command_um
            self._command_um = axis.command_um
            self._moved_ns += moves * passed_ns
            calm = now_ns > self._calm_ns and self._moved_ns > self._judged_ns
            if moves and calm and axis.mode is Mode.ADAPTIVE:
                self._count_error(axis.command_um - axis.position_um)
        if now_ns <= self._disturbed_ns:
            self._expect_learning()
        if now_ns >= self._row_ns:
            self._end_row(now_ns)

    def _expects(self, what: State | Fault) -> bool:
        return self._asked.get(what, -1) >= self._now_ns

    def _judge_state(self, record: CycleRecord) -> None:
        state, before = record.state, self._state
        faults = record.present | record.latched
        if state in {State.RUN, State.IDENT}:
            explained = before in MOVES_FROM
        elif state in STOPS:
            explained = self._expects(state) or bool(faults & STOPPING)
        else:
            explained = True
        if not explained:
            text = ", ".join(ids(faults)) or "none"
            self._violate(f"{before} became {state} without a reason; faults: {text}")

    def _judge_faults(self, record: CycleRecord) -> None:
        for fault in ids(record.present & ~self._present):
            self.seen[fault] += 1
        if self._now_ns > self._calm_ns:
            for fault in ids(record.present & ~self._present & DEGRADING):
                learned = self._moved_ns <= self._taught.get(fault, -1)
                if not (learned or self._expects(fault)):
                    self._violate(f"{fault} in {record.state} without a cause")

    def _violate(self, text: str) -> None:
        if len(self.violations) < MOST_VIOLATIONS:
            self.violations.append(f"at {self._now_ns / NS_PER_S:.2f} s: {text}")

    def _count_error(self, error_um: float) -> None:
        if isfinite(error_um):
            self._sum += error_um * error_um
            self._largest = max(self._largest, abs(error_um))
            self._counted += 1

    def _end_row(self, now_ns: int) -> None:
        if self._row_ns:
            self.rows.append(self._row(now_ns))
        else:
            self._began_ns = now_ns
        self._row_ns = now_ns + ROW_NS
        if self._judges_error:
            self._sum = self._largest = 0.0
            self._counted = 0
        self._row_cycles = self._row_runs = 0

    @property
    def _judges_error(self) -> bool:
        """Whether enough cycles count: one that lags at the start of a move is no minute."""
        return 2 * self._counted >= self._row_cycles

    def _row(self, now_ns: int) -> Row:
        percent = 100.0 / self._range_um
        sizes = [each.stat().st_size for each in self._folder.rglob("*") if each.is_file()]
        judged = self._judges_error
        return Row(
            hour=(now_ns - self._began_ns) / NS_PER_S / 3600,
            rss_mb=_resident_mb(),
            descriptors=len(list(Path("/proc/self/fd").iterdir())),
            threads=threading.active_count(),
            files=len(sizes),
            files_mb=sum(sizes) / 1e6,
            blocks=sys.getallocatedblocks(),
            drift_pct=self.drift_pct,
            error_rms_pct=sqrt(self._sum / self._counted) * percent if judged else nan,
            error_max_pct=self._largest * percent if judged else nan,
            run_share=self._row_runs / self._row_cycles,
            faults=self.seen.total(),
            daemons=self.daemons,
            output_faults=self.output_faults,
            piezod_step_v=self.device.largest_v if self.device else 0.0,
            amplifier_step_v=self.device.output.largest_step_v if self.device else 0.0,
        )


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
