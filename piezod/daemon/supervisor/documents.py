"""Documents about a stage, for clients: status, faults, timing of the loop."""

from collections.abc import Sequence
from typing import Any, Final

from piezod.config.daemon import DaemonConfig
from piezod.config.drive_limits import DriveLimit
from piezod.config.gate_reasons import GateReason
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.faults.table import FAULTS
from piezod.telemetry.learned import LearnedAxis, LearnedReader
from piezod.telemetry.ring import Record
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.succession import succession_of
from piezod.telemetry.words import Word

Document = dict[str, Any]

MODES: Final = tuple(Mode)
STATES: Final = tuple(State)
GATES: Final = tuple(GateReason)
LIMITED_BY: Final = tuple(DriveLimit)

_NUMBERS: Final = ("position_um", "command_um", "drive_v", "target_um", "read_back_v", "trim_um")


def status(
    config: DaemonConfig, shared: SharedMap, record: Record | None, learned: LearnedReader
) -> Document:
    """Return the status of a stage.

    Args:
        config: Its configuration.
        shared: The memory shared with the loop.
        record: The newest record; None before the first.
        learned: What each axis has learned.
    """
    axes = {
        name: {
            "has_sensor": axis.sensor is not None,
            **_axis(None if record is None else record["axes"][i], config),
            "learned_pct": _learned_pct(learned.read(i)),
        }
        for i, (name, axis) in enumerate(config.axes.items())
    }
    if record is not None and STATES[record["state"]] is State.BLIND:
        for axis in axes.values():  # the record has only the last written voltage
            axis["drive_v"] = axis["read_back_v"]
    obtained = _obtained(shared)
    modes = {axis["mode"] for axis in axes.values()}
    return {
        "title": config.title,
        "state": state_of(shared, record).value,
        "mode": modes.pop() if len(modes) == 1 else "mixed",
        "shadow": record is not None and record["shadow"],
        "faults": faults_of(shared, record),
        "rate_hz": config.rate_hz,
        "skipped_cycles": shared.words[Word.SKIPPED_CYCLES],
        "processor": obtained["processor"],
        "not_realtime": [step["name"] for step in obtained["steps"] if not step["ok"]],
        "devices": obtained["devices"],
        "axes": axes,
    }


def state_of(shared: SharedMap, record: Record | None) -> State:
    """Return the state of the same cycle as the faults: the loop may be at the next one already."""
    if record is not None:
        return STATES[record["state"]]
    waits = STATES[shared.words[Word.LOOP_STATE]] is State.BLIND
    return State.BLIND if waits else State.BOOT


def _learned_pct(learned: LearnedAxis | None) -> float:
    """Return how far a learned model is from the identified one, in % of the range."""
    return float("nan") if learned is None else 100.0 * learned.distance


def _axis(record: Record | None, config: DaemonConfig) -> Document:
    if record is None:  # before the first cycle: the same keys, without values
        unknown = dict.fromkeys(_NUMBERS, float("nan"))
        known = {"mode": config.mode.value, "gate": "", "on_target": False, "motion": 0}
        return {**unknown, **known, "limited": DriveLimit.NONE.value}
    return {
        **{name: record[name] for name in _NUMBERS},
        "mode": MODES[record["mode"]].value,
        "gate": str(GATES[record["gate"]].value),
        "on_target": record["on_target"],
        "motion": record["motion"],
        "limited": LIMITED_BY[record["limited"]].value,
    }


def masks(record: Record) -> tuple[int, int]:
    """Return the masks of present and of latched faults of a record, one bit for each fault."""
    # Two fields of 64 bits each, because there are more than 64 faults.
    return (
        record["present_lo"] | record["present_hi"] << 64,
        record["latched_lo"] | record["latched_hi"] << 64,
    )


def faults_of(shared: SharedMap, record: Record | None) -> list[Document]:
    """Return the documents of the faults of a loop.

    Args:
        shared: The memory shared with the loop.
        record: The newest record; before the first, the faults of the loop before it are latched.
    """
    if record is not None:
        return faults(*masks(record))
    succession = succession_of(shared)
    return faults(0, succession.latched if succession else 0)


def faults(present: int, latched: int) -> list[Document]:
    """Return the documents of the faults that are present or latched."""
    return [
        {
            "id": rule.id,
            "name": rule.name,
            "severity": rule.severity,
            "present": bool(present >> i & 1),
            "latched": bool(latched >> i & 1),
            "remedy": rule.remedy,
        }
        for i, rule in enumerate(FAULTS)
        if (present | latched) >> i & 1
    ]


def fault_ids(mask: int) -> Sequence[str]:
    """Return the ids of the faults in a mask."""
    return [rule.id for i, rule in enumerate(FAULTS) if mask >> i & 1]


def realtime(config: DaemonConfig, shared: SharedMap) -> Document:
    """Return what the loop process obtained from the operating system, and its counters."""
    words = shared.words
    return {
        "rate_hz": config.rate_hz,
        "measured_rate_hz": words[Word.MEASURED_RATE_HZ],
        "loop_pid": words[Word.LOOP_PID],
        **_obtained(shared),
        "healthy_cycles": words[Word.HEALTHY_CYCLES],
        "skipped_cycles": words[Word.SKIPPED_CYCLES],
        "requests_expired": words[Word.REQUESTS_EXPIRED],
        "gc_collections": words[Word.GC_COLLECTIONS],
        "minor_faults": words[Word.MINOR_FAULTS],
        "major_faults": words[Word.MAJOR_FAULTS],
        "allocated_blocks": words[Word.ALLOCATED_BLOCKS],
    }


def _obtained(shared: SharedMap) -> Document:
    """Return the real-time steps, the devices and the processor that the loop has reported."""
    report: Document = shared.report() or {}
    return {"steps": [], "devices": [], "processor": None, **report}
