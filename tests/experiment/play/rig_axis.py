"""An axis of a simulated rig that plays tables, for tests of the procedures."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezod.control.guard import Limits
from piezod.control.law.model import StageModel
from piezod.control.law.model_files import read_model
from piezod.control.table_guard import TableGuard
from piezod.devices.interface import Wiring
from piezod.devices.played_axis import AxisPlayRecord, AxisTable, PlayedAxis
from piezod.devices.player import AtEnd, PlayerCapabilities
from piezod.devices.wiring import ChannelPair
from piezod.dynamics.harmonics import MEASURED_SHIFT
from piezod.dynamics.model import Resonance, ResponseModel
from piezod.experiment.play.command import PeriodicCommand
from piezod.experiment.play.response import KnownResponse
from piezod.experiment.play.stage import AtRest
from piezod.experiment.play.tables import TableMaker
from piezod.experiment.play.task import KnownAxis, LearningTask, PlaySettings
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions

CONFIG: Final = Path(__file__).parents[3] / "config"
INTERVAL_NS: Final = 50_000
LIMITS: Final = Limits(0.0, 150.0, 250_000.0)
SENSOR_DELAY_S: Final = 171e-6
SETTINGS: Final = PlaySettings(passes=6, settle_s=0.3, record_s=0.2)
RESPONSE: Final = ResponseModel(248e-6, (Resonance(807.0, 0.0291),))
OPTIONS: Final[dict[str, dict[str, float]]] = {
    "amplifier": {"current_limit_a": 1.0, "slew_v_per_s": 3e5, "capacitance_uf": 3.0},
    "sensor": {"antialias_hz": 5000.0, "bandwidth_hz": 1e4, "delay_s": 110e-6},
}
PAIR: Final = ChannelPair("rig", "rig")
Record = Callable[[AxisPlayRecord], AxisPlayRecord]


def model() -> StageModel:
    """Return the shipped model, which was identified on this specimen."""
    return read_model(CONFIG / "models" / "simulated-stack.yaml")[0].zeroed_at(0.0)


def sine(
    frequency_hz: float = 200.0, low_um: float = 4.0, high_um: float = 24.0
) -> PeriodicCommand:
    """Return a sine."""
    n = round(1e9 / frequency_hz / INTERVAL_NS)
    turns = np.arange(n) / n
    values_um = low_um + (high_um - low_um) * (0.5 - 0.5 * np.cos(2 * np.pi * turns))
    return PeriodicCommand(f"sine {frequency_hz:g} Hz", values_um, INTERVAL_NS)


def maker(limits: Limits = LIMITS) -> TableMaker:
    """Return the maker of tables for the shipped model."""
    ends_v = limits.drive_min_v, limits.drive_max_v
    return TableMaker(model(), INTERVAL_NS, ends_v, limits.slew_v_per_s)


def known_response(response: ResponseModel = RESPONSE) -> KnownResponse:
    """Return a response that is known up to 2850 Hz."""
    return KnownResponse(response, 2850.0, np.empty(0), np.empty(0), MEASURED_SHIFT)


def task(
    command: PeriodicCommand,
    settings: PlaySettings = SETTINGS,
    limits: Limits = LIMITS,
    first_um: FloatArray | None = None,
) -> LearningTask:
    """Return the task to learn a command on the rig."""
    known = KnownAxis(maker(limits), model().creep, known_response(), SENSOR_DELAY_S)
    return known.task(command, settings, first_um)


class RigAxis:
    """Implements `PlayedStage` on a simulated rig, which may change from play to play.

    Args:
        limits: Limits of the guard.

    Attributes:
        tables: Tables that the guard has accepted.
    """

    def __init__(self, limits: Limits = LIMITS) -> None:
        self._now_ns, self._zero = 0, (0.0, 0.0)
        self._guard = TableGuard(limits, 0.0, AtEnd.HOLDS, 10**9)
        self._record: Record = lambda record: record
        self.tables: list[AxisTable] = []
        self.use()

    def use(self, **changes: dict[str, Any]) -> None:
        """Go on with a rig of these parameters, at rest, and zero its sensor."""
        options = {part: {**OPTIONS.get(part, {}), **changes.get(part, {})} for part in
                   (*OPTIONS, "stage")}  # fmt: skip
        rig = SimulatedRig(SimulatedOptions.model_validate(options), Wiring.both(("x",)), 1)
        rig.open()
        rig.activate(self._now_ns)
        self._rig, self._played = rig, PlayedAxis("x", {"rig": rig}, {"x": PAIR})
        self._zero = (0.0, 0.0)
        record = self._play_now(AxisTable(INTERVAL_NS, np.zeros(0), np.zeros(2000), 1))
        self._zero = float(np.mean(record.position_um)), float(np.mean(record.true_um))

    @property
    def capabilities(self) -> PlayerCapabilities:
        """Capabilities of the rig."""
        return self._played.capabilities

    def spoil(self, record: Record) -> None:
        """Change all later records."""
        self._record = record

    def rest(self) -> AtRest:
        """Ramp to 0 V."""
        (from_v,) = self._rig.abort(self._now_ns)
        down_v = from_v * (0.5 + 0.5 * np.cos(np.pi * np.arange(2000) / 2000))
        self._play_now(AxisTable(INTERVAL_NS, down_v, np.zeros(4000), 1))
        return AtRest(self._now_ns / NS_PER_S, self._rig.read_back(self._now_ns)[0])

    def play(self, table: AxisTable) -> AxisPlayRecord:
        """Play a table that the guard accepts."""
        self._guard.check(table, self._rig.read_back(self._now_ns)[0])
        self.tables.append(table)
        return self._record(self._play_now(table))

    def _play_now(self, table: AxisTable) -> AxisPlayRecord:
        self._played.load(table, self._now_ns)
        self._rig.arm()
        self._rig.start(self._now_ns)
        self._now_ns += table.duration_ns + table.interval_ns
        self._rig.progress(self._now_ns)
        record = self._played.recording()
        return record._replace(
            position_um=record.position_um - self._zero[0], true_um=record.true_um - self._zero[1]
        )
