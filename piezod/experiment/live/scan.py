"""A scan on a running stage, whose device plays it by its own clock."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from piezod.client import StageClient
from piezod.config.scan import AnyScan, ScannedAxis, broken_scan, scanned
from piezod.errors import DataError
from piezod.experiment.live.play import REST_S, measured_axis
from piezod.experiment.live.running_axis import playing_axis
from piezod.experiment.live.scan_loop import scan_by_running_loop
from piezod.experiment.live.setup import LiveSetup, read_setup
from piezod.experiment.live.stage import LiveStage
from piezod.experiment.play.axis import PlayingAxis
from piezod.experiment.scan.by_loop import or_by_loop
from piezod.experiment.scan.edges import sweep_ns
from piezod.experiment.scan.pixels import SweepSamples
from piezod.experiment.scan.plan import PlannedAxis, check_device, plan_scan
from piezod.experiment.scan.run import (
    ScanResult,
    ScanSetting,
    Told,
    beside_of,
    planned_axis,
    run_scan,
    with_measured_mode,
)
from piezod.experiment.scan.stage import ScanTable, SeenEdge
from piezod.messages.documents import Document
from piezod.units import NS_PER_S, to_ascii

_DECIMALS = 5
"""Digits of a voltage behind the point: 10 µV."""


class RunningScanStage:
    """Implements `ScanStage` for axes of a running stage.

    Args:
        stage: The stage, armed and at rest.
        axes: Its axes, by name.
        note: Called when a scan begins to wait for edges.
    """

    def __init__(
        self, stage: LiveStage, axes: Mapping[str, PlayingAxis], note: Callable[[str], None]
    ) -> None:
        self._stage, self._axes, self._note = stage, axes, note
        self.edges: tuple[SeenEdge, ...] = ()
        """The edges that the last scan has seen."""

    def rest(self) -> None:
        """Bring all axes to rest."""
        self._stage.pause(REST_S)

    def scan(self, table: ScanTable) -> Iterator[SweepSamples]:
        """Play a scan, which the daemon checks; yield the samples of each sweep."""
        zero_um = np.array([self._axes[name].stage.zero_um for name in table.axes])
        self.edges, waits = (), False
        for document in self._stage.scan(**_request(table, float(zero_um[0]))):
            if not waits and (waits_s := document.get("waits_s")):
                waits = True
                self._note(f"the stage waits for pulses, {waits_s:g} s for each: start them")
            self.edges = tuple(SeenEdge(*edge) for edge in document.get("edges", ()))
            first_ns = sweep_ns(table, self.edges)
            samples, first = document["samples"], document["first"]
            position_um, detected = (
                np.array([samples[name] for name in document[kind]], dtype=np.float64)
                for kind in ("axes", "inputs")
            )
            for i in range(position_um.shape[1] // table.points):
                part = slice(i * table.points, (i + 1) * table.points)
                measured = position_um[:, part].T
                yield SweepSamples(
                    first + i,
                    int(first_ns[first + i]),
                    measured - zero_um,
                    np.full(measured.shape, np.nan),
                    detected[:, part].T if detected.size else np.empty((table.points, 0)),
                )


def _request(table: ScanTable, zero_um: float) -> Document:
    """Return the fields of the request of a scan, whose first sensor has this zero."""
    curves = {
        name: {
            "lead_in_v": np.round(table.lead_in_v[:, i], _DECIMALS).tolist(),
            "line_v": np.round(table.line_v[:, i], _DECIMALS).tolist(),
            "offset_v": np.round(table.offset_v[:, i], _DECIMALS).tolist(),
            "scale": np.round(table.scale[:, i], 7).tolist(),
            "blend": np.round(table.blend[:, i], 7).tolist(),
        }
        for i, name in enumerate(table.axes)
    }
    edges: dict[str, float] | None = None
    if table.edges is not None:
        first, every, times, within_ns = table.edges
        edges = {"first": first, "every": every, "times": times, "tail": table.tail}
        edges["within_s"] = within_ns / NS_PER_S
    compared: dict[str, float] | None = None
    if (own := table.compared) is not None:
        ends = {"first_um": own.first + zero_um, "last_um": own.last + zero_um}
        compared = {"line": own.line, **ends, "step_um": own.step}
    return {
        "axes": curves,
        "interval_s": table.interval_ns / NS_PER_S,
        "pulses": table.pulses.tolist(),
        "frame_pulse": table.framed,
        "frame_points": table.frame_points,
        "pause": table.pause,
        "edges": edges,
        "compared": compared,
    }


def scan_live(client: StageClient, scan: AnyScan, setting: ScanSetting, told: Told) -> ScanResult:
    """Run a scan on a running stage, by its device or its loop, and disarm it at the end.

    Args:
        client: A connection to the daemon of the stage.
        scan: The scan.
        setting: How it is run.
        told: Who is told what.

    Raises:
        ClientError: If a request is refused, or the stage leaves the expected states.
        ConfigError: If a table file is not valid.
        DataError: If the scan does not fit the stage, before anything moves; or if a record cannot
            be used.
        ModelError: If a model in use is not valid.
        OSError: If the file cannot be written.
    """
    setup = read_setup(client)
    _check(scan, setup)
    names = [span.axis for span in scan.spans]
    planned = {name: _planned(setup, name) for name in names}
    if scan.mode is not None:
        units = {name: to_ascii(axis["unit"]) for name, axis in setup.user_axes.items()}
        used = {name: unit for name, unit in units.items() if name in names and unit != "um"}
        setting = setting._replace(units=used)
        return scan_by_running_loop(client, setup, scan, scan.mode, planned, setting, told)
    devices = {each["name"]: each for each in client.status().devices}
    device = devices.get(setup.axes[names[0]].config.amplifier.device, {})
    check_device(scan, device.get("edge_waits", 0), device.get("pulses_at", ()))
    plan_scan(scan, planned)
    inputs = beside_of(setup.axes[name].config for name in names)
    with LiveStage(client, setup, lambda _over_s: None) as stage:
        stage.arm_at_rest(REST_S)
        make = partial(playing_axis, stage, setup, interval_ns=scan.interval_ns, rest_s=REST_S)
        with or_by_loop():
            axes = {name: make(name) for name in names}
        known = {name: measured_axis(axis) for name, axis in axes.items()}
        plan = plan_scan(
            scan, {name: with_measured_mode(planned[name], known[name]) for name in names}
        )
        on = RunningScanStage(stage, axes, told.note)
        result = run_scan(scan, plan, axes, known, on, inputs, setting, told)
        stage.disarm()
    return result


def _planned(setup: LiveSetup, name: str) -> PlannedAxis:
    """Return what a plan needs to know of an axis; a user axis is as fast as its actuators."""
    by = {
        each: planned_axis(setup.axes[each].config, setup.model_of(each))
        for each in setup.moved_by(name)
    }
    if name not in setup.user_axes:
        return by[name]
    low, high = setup.user_axes[name]["command_range_um"]
    modes_hz = [each.mode_hz for each in by.values() if each.mode_hz is not None]
    speed = setup.user_speed(name, {each: one.speed_um_per_s for each, one in by.items()})
    return PlannedAxis((low, high), min(modes_hz, default=None), speed, 0.0)


def _check(scan: AnyScan, setup: LiveSetup) -> None:
    """Refuse a scan that does not fit the stage; the text has a line for each problem."""
    users = {
        name: ScannedAxis(tuple(axis["command_range_um"])) for name, axis in setup.user_axes.items()
    }
    moved = {each for name in users for each in setup.moved_by(name)}
    alone = {name: scanned(axis.config) for name, axis in setup.axes.items() if name not in moved}
    problems = [
        f"{'.'.join(map(str, path))}: {what}"
        for path, what in broken_scan(scan, {**users, **alone})
    ]
    if scan.mode is None and any(span.axis in users for span in scan.spans):
        problems.append("mode: needed, because the loop moves user axes, no table of a device")
    if problems:
        raise DataError("\n".join(f"stage {setup.stage}: {problem}" for problem in problems))
    for span in scan.spans:
        for axis in setup.moved_by(span.axis):
            setup.measured_axis(axis, "a scan")
            setup.model_of(axis)
