"""Learned tables as files, and under which conditions they may be used again."""

import hashlib
import json
import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

import piezod
from piezod.config.table_file import DeviceIdentity, TableFile, dump_table, load_table
from piezod.control.law.model import StageModel
from piezod.devices.interface import Identity, is_same
from piezod.experiment.play.command import PeriodicCommand
from piezod.experiment.play.learn import LearnedPlay
from piezod.hysteresis.memory import FloatArray
from piezod.records.atomic import replacing

_OTHER_CHARACTERS = re.compile(r"[^A-Za-z0-9]+")
_SAME_UM = 1e-6
"""Largest difference of two commands that count as the same, in µm."""


class Conditions(NamedTuple):
    """Conditions of a learned table; under other ones it is not used."""

    axis: str  #: Name of the axis.
    device: Identity  #: Identity of the device that plays.
    model_sha256: str  #: Hash of the model of the axis.
    sensor_delay_s: float  #: Part of the delay that is the sensor's, in s.
    rest_v: float  #: Voltage at rest, in V.

    def changed(self, table: TableFile, command: PeriodicCommand) -> Iterator[str]:
        """Yield the conditions of a table that have changed, in words."""
        if table.axis != self.axis:
            yield f"axis {table.axis}, now {self.axis}"
        device = table.device
        known = Identity(device.maker, device.model, device.serial, "unknown")
        if not is_same(self.device, known):
            yield f"device {' '.join(known[:3])}, now {' '.join(self.device[:3])}"
        if table.model_sha256 != self.model_sha256:
            yield f"model {table.model_sha256[:8]}…, now {self.model_sha256[:8]}…"
        if table.interval_ns != command.interval_ns:
            yield f"interval {table.interval_ns} ns, now {command.interval_ns} ns"
        if table.sensor_delay_s != self.sensor_delay_s:
            yield f"sensor_delay_s {table.sensor_delay_s:g} s, now {self.sensor_delay_s:g} s"
        if table.rest_v != self.rest_v:
            yield f"rest_v {table.rest_v:g} V, now {self.rest_v:g} V"
        yield from _changed_waveform(np.array(table.command_um), command.values_um)


def _changed_waveform(stored_um: FloatArray, values_um: FloatArray) -> Iterator[str]:
    if stored_um.size != values_um.size:
        yield f"{stored_um.size} points per period, now {values_um.size}"
    elif not np.max(np.abs(stored_um - values_um)) <= _SAME_UM:
        off_um = float(np.mean(values_um) - np.mean(stored_um))
        if np.max(np.abs(stored_um + off_um - values_um)) <= _SAME_UM:
            yield f"offset {np.mean(stored_um):g} µm, now {np.mean(values_um):g} µm"
        else:
            yield "another waveform"


def model_sha256(model: StageModel) -> str:
    """Return a hash of a model: equal for models that give the same voltages."""
    content = [
        repr(model.form),
        model.weights.tolist(),
        [*model.drive_v, *model.position_um],
        model.creep.time_constants_s.tolist(),
        model.creep.weights.tolist(),
    ]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def to_table_file(play: LearnedPlay, conditions: Conditions, created_at: datetime) -> TableFile:
    """Return the contents of a table file.

    Args:
        play: The learned waveform.
        conditions: Its conditions.
        created_at: Present time, with a time zone.
    """
    maker, model, serial, _ = conditions.device
    return TableFile(
        created_at=created_at.isoformat(timespec="seconds"),
        created_by=f"piezod {piezod.__version__}",
        axis=conditions.axis,
        waveform=play.given.name,
        device=DeviceIdentity(maker=maker, model=model, serial=serial),
        model_sha256=conditions.model_sha256,
        interval_ns=play.given.interval_ns,
        sensor_delay_s=conditions.sensor_delay_s,
        rest_v=conditions.rest_v,
        passes=play.best.label,
        error_max_pct=play.best.measured.max_pct,
        error_rms_pct=play.best.measured.rms_pct,
        command_um=tuple(play.given.values_um.tolist()),
        wanted_um=tuple(play.wanted_um.tolist()),
        drive_v=tuple(play.best.table.period_v.tolist()),
    )


def write_table(path: Path, table: TableFile) -> None:
    """Write a table file.

    Raises:
        OSError: If the file cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_text(dump_table(table), encoding="utf-8")


def store_table(folder: Path, play: LearnedPlay, conditions: Conditions) -> str:
    """Store a learned waveform under its name, for `find_table`; return the name of the file.

    Raises:
        OSError: If the file cannot be written.
    """
    part = _OTHER_CHARACTERS.sub("-", play.given.name).strip("-") or "wave"
    path = folder / f"table_{conditions.axis}_{part}.yaml"
    write_table(path, to_table_file(play, conditions, datetime.now().astimezone()))
    return path.name


class FoundTable(NamedTuple):
    """A stored table for a command."""

    #: (n,) its input of the inverse model, in µm; None if no table may be used.
    wanted_um: FloatArray | None
    note: str  #: Which table is used, or why none is, for people.


def find_table(folder: Path, conditions: Conditions, command: PeriodicCommand) -> FoundTable:
    """Return the newest table in a folder whose conditions agree.

    Raises:
        ConfigError: If a table file is not valid.
    """
    tables = [(load_table(path), path) for path in sorted(folder.glob("table_*.yaml"))]
    tables.sort(key=lambda one: datetime.fromisoformat(one[0].created_at), reverse=True)
    changes = {path: tuple(conditions.changed(table, command)) for table, path in tables}
    for table, path in tables:
        if not changes[path]:
            note = f"begins with {path.name}, learned on {table.created_at[:10]}"
            return FoundTable(np.array(table.wanted_um), note)
    named = [(changes[path], path) for table, path in tables if table.waveform == command.name]
    if not named:
        return FoundTable(None, f"no table of this waveform in {folder}")
    why, path = named[0]
    return FoundTable(None, f"{path.name} is not used, changed since: {'; '.join(why)}")
