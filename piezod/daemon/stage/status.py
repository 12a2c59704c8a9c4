"""What a stage tells of itself, from the memory that is shared with its loop."""

from collections.abc import Sequence
from dataclasses import fields, replace
from math import isfinite
from typing import Any, Final

import piezod
from piezod.config.daemon import DaemonConfig
from piezod.config.states import State
from piezod.control.faults.table import FAULTS
from piezod.coordinates.paths import distance_to_path
from piezod.messages.answers import AxisStatus, Fault, Processor, Realtime, Status
from piezod.messages.documents import Document
from piezod.telemetry.layout import AXIS_FIELDS, as_shown
from piezod.telemetry.learned import LearnedAxis, LearnedReader
from piezod.telemetry.ring import Record
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.succession import succession_of
from piezod.telemetry.words import Word

STATES: Final = tuple(State)
PATH: Final = 64
"""Records among which the nearest point of the path is: the stage follows a little later."""
_RECORDED: Final = {each.name for each in fields(AxisStatus)} & {each.name for each in AXIS_FIELDS}
"""Fields of the status of an axis that its record has, too."""
_COUNTED: Final = tuple(
    each.name for each in fields(Realtime) if each.name.upper() in Word.__members__
)
"""Fields of the real-time answer that are words of the shared memory."""


def status(
    stage: str,
    config: DaemonConfig,
    shared: SharedMap,
    newest: Sequence[Record],
    learned: LearnedReader,
) -> Status:
    """Return the status of a stage.

    Args:
        stage: Its name.
        config: Its configuration.
        shared: The memory shared with the loop.
        newest: The newest records, the last one last; none before the first.
        learned: What each axis has learned.
    """
    record = newest[-1] if newest else None
    users = {
        name: AxisStatus(unit=axis.unit, **_recorded(record["axes"][i] if record else None, config))
        for i, (name, axis) in enumerate(config.user_axes.items(), len(config.axes))
    }
    axes = users | {
        name: AxisStatus(
            has_sensor=axis.sensor is not None,
            moved_by=config.moved_by(name),
            learned_pct=_learned_pct(learned.read(i)),
            **_recorded(record["axes"][i] if record else None, config),
        )
        for i, (name, axis) in enumerate(config.axes.items())
    }
    state = state_of(shared, record)
    if record is not None and state is State.BLIND:  # it has only the last written voltage
        axes = {name: replace(axis, drive_v=axis.read_back_v) for name, axis in axes.items()}
    obtained = _obtained(shared)
    modes = {axis.mode for axis in axes.values()}
    return Status(
        stage=stage,
        title=config.title,
        state=state.value,
        mode=modes.pop() if len(modes) == 1 else "mixed",
        shadow=record is not None and record["shadow"],
        faults=faults_of(shared, record),
        rate_hz=config.rate_hz,
        skipped_cycles=shared.words[Word.SKIPPED_CYCLES],
        build=piezod.build(),
        not_realtime=tuple(step["name"] for step in obtained["steps"] if not step["ok"]),
        axes=axes,
        contour_um=_contour_um(config, newest),
        devices=obtained["devices"],
        processor=obtained["processor"],
    )


def _contour_um(config: DaemonConfig, newest: Sequence[Record]) -> float | None:
    """Return how far the stage is from the path of its command; None if nobody knows."""
    if config.transform is None or not newest:
        return None
    places = [config.shown_axes.index(name) for name in config.transform.contour_axes]
    if not places:
        return None
    path = [[record["axes"][i]["command_um"] for i in places] for record in newest]
    known = [point for point in path if all(map(isfinite, point))]
    position = [newest[-1]["axes"][i]["position_um"] for i in places]
    return as_shown("", distance_to_path(position, known)) if known else None


def state_of(shared: SharedMap, record: Record | None) -> State:
    """Return the state of the same cycle as the faults: the loop may be at the next one already."""
    if record is not None:
        return STATES[record["state"]]
    waits = STATES[shared.words[Word.LOOP_STATE]] is State.BLIND
    return State.BLIND if waits else State.BOOT


def _learned_pct(learned: LearnedAxis | None) -> float | None:
    """Return how far a learned model is from the identified one, in % of the range."""
    return None if learned is None else 100.0 * learned.distance


def _recorded(record: Record | None, config: DaemonConfig) -> Document:
    if record is None:  # before the first cycle nothing else is known
        return {"mode": config.mode.value}
    return {name: as_shown(name, record[name]) for name in _RECORDED}


def masks(record: Record) -> tuple[int, int]:
    """Return the masks of present and of latched faults of a record, one bit for each fault."""
    # Two fields of 64 bits each, because there are more than 64 faults.
    return (
        record["present_lo"] | record["present_hi"] << 64,
        record["latched_lo"] | record["latched_hi"] << 64,
    )


def faults_of(shared: SharedMap, record: Record | None) -> tuple[Fault, ...]:
    """Return the faults of a loop that are present or latched.

    Args:
        shared: The memory shared with the loop.
        record: The newest record; before the first, the faults of the loop before it are latched.
    """
    if record is not None:
        present, latched = masks(record)
    else:
        succession = succession_of(shared)
        present, latched = 0, succession.latched if succession else 0
    return tuple(
        Fault(
            id=rule.id,
            name=rule.name,
            severity=rule.severity,
            present=bool(present >> i & 1),
            latched=bool(latched >> i & 1),
            remedy=rule.remedy,
        )
        for i, rule in enumerate(FAULTS)
        if (present | latched) >> i & 1
    )


def fault_ids(mask: int) -> Sequence[str]:
    """Return the ids of the faults in a mask."""
    return [rule.id for i, rule in enumerate(FAULTS) if mask >> i & 1]


def realtime(config: DaemonConfig, shared: SharedMap) -> Realtime:
    """Return what the loop process obtained from the operating system, and its counters."""
    counted: dict[str, Any] = {name: shared.words[Word[name.upper()]] for name in _COUNTED}
    return Realtime(rate_hz=config.rate_hz, **counted, **_obtained(shared))


def _obtained(shared: SharedMap) -> Document:
    """Return the real-time steps, the devices and the processor that the loop has reported."""
    report = {"steps": (), "devices": (), "processor": None, **(shared.report() or {})}
    processor = report["processor"]
    return {
        "steps": tuple(report["steps"]),
        "devices": tuple(report["devices"]),
        "processor": Processor(**processor) if processor else None,
    }
