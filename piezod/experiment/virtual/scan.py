"""A scan in virtual time: identify the axes, learn, play, and store."""

from collections.abc import Iterator, Mapping

import numpy as np

from piezod.config.experiment import ExperimentConfig
from piezod.config.scan import AnyScan
from piezod.control.law.compensated import limits_of
from piezod.control.table_guard import TableGuard, TableRefusedError
from piezod.devices.played_scan import BlockRecord, PlayedScan, missing_edge
from piezod.devices.player import CountsPulses, SeenEdge
from piezod.errors import DataError
from piezod.experiment.play.axis import PlayingAxis
from piezod.experiment.scan.by_loop import or_by_loop
from piezod.experiment.scan.edges import sweep_ns
from piezod.experiment.scan.pixels import SweepSamples
from piezod.experiment.scan.plan import check_device, plan_scan
from piezod.experiment.scan.run import (
    ScanResult,
    ScanSetting,
    Told,
    planned_axis,
    run_scan,
    with_measured_mode,
)
from piezod.experiment.scan.stage import ScanTable
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.play import VirtualAxis
from piezod.experiment.virtual.scan_loop import scan_by_virtual_loop
from piezod.experiment.virtual.stage import VirtualStage, opened


class VirtualScanStage:
    """Implements `ScanStage` for axes of a virtual stage.

    Args:
        stage: The stage.
        played: Its axes that play.
        axes: The same, at rest, by name.
        guards: Guard of each, by name.
        rest_s: Time of a rest, in s.
    """

    def __init__(
        self,
        stage: VirtualStage,
        played: PlayedScan,
        axes: Mapping[str, PlayingAxis],
        guards: Mapping[str, TableGuard],
        rest_s: float,
    ) -> None:
        self._stage, self._played, self._guards = stage, played, guards
        self._axes, self._rest_s = axes, rest_s
        self.edges: tuple[SeenEdge, ...] = ()
        """The edges that the last scan has seen."""

    def rest(self) -> None:
        """Bring all axes to rest."""
        self._stage.go_to_rest(self._rest_s)

    def scan(self, table: ScanTable) -> Iterator[SweepSamples]:
        """Play a scan; yield the samples of each sweep."""
        zero_um = np.array([self._axes[name].stage.zero_um for name in table.axes])
        true_zero_um = np.array([self._axes[name].stage.true_zero_um for name in table.axes])
        rest: BlockRecord | None = None
        k, m, self.edges = 0, table.points, ()
        for block in self._played.blocks(table):
            record = self._stage.play_block(self._played, table, block, self._guards)
            if record is None:
                continue
            self.edges += record.edges
            first_ns = sweep_ns(table, self.edges).tolist()
            rows = record if rest is None else rest.joined(record)
            while k < table.sweeps and len(rows.position_um) >= m:
                sweep, rows = rows.split(m)
                yield SweepSamples(
                    k,
                    first_ns[k],
                    sweep.position_um - zero_um,
                    sweep.true_um - true_zero_um,
                    sweep.detected,
                )
                k += 1
            rest = rows
            if why := missing_edge(table, record):
                raise DataError(why)


def scan_virtually(
    config: ExperimentConfig,
    scan: AnyScan,
    setting: ScanSetting,
    told: Told,
) -> ScanResult:
    """Run the scan of an experiment in virtual time, on a device that plays or by the loop.

    Raises:
        ConfigError: If a model file or a table file cannot be used.
        DataError: If the scan does not fit an axis or the device, before anything moves; or if a
            record cannot be used.
        DeviceError: If a device cannot be opened, does not play, or refuses a table.
        ModelError: If a gain is not safe.
    """
    if scan.mode is not None:
        return scan_by_virtual_loop(config, scan, scan.mode, setting, told)
    names = [span.axis for span in scan.spans]
    with opened(config, lambda _: None) as stage:
        with or_by_loop():
            played = stage.played_scan(names)
        check_device(scan, played.capabilities.edge_waits, played.capabilities.pulses_at)
        identified = identify_axes(stage, config)
        planned = {
            name: planned_axis(identified[name].config, identified[name].model) for name in names
        }
        able, guards, axes = played.capabilities, {}, {}
        plan_scan(scan, planned)
        stage.rest(config.settle_s)
        for name in names:
            limits = config.axes[name].limits
            guard = TableGuard(
                limits_of(config.axes[name]), limits.rest_v, able.at_end, able.cycles
            )
            resting = VirtualAxis(stage, name, guard, limits.rest_v, config.settle_s)
            model = identified[name].model
            axes[name] = PlayingAxis.at_rest(
                resting, name, config.axes[name], model, scan.interval_ns
            )
            guards[name] = guard
        known = {name: axis.slowly_known(TableRefusedError) for name, axis in axes.items()}
        plan = plan_scan(
            scan, {name: with_measured_mode(planned[name], known[name]) for name in names}
        )
        on = VirtualScanStage(stage, played, axes, guards, config.settle_s)
        result = run_scan(scan, plan, axes, known, on, played.beside, setting, told)
        if isinstance(played.player, CountsPulses) and scan.pulses.highest:
            counted = played.player.pulses_counted()[: scan.pulses.highest]
            told.note(f"pulses of the device, in all frames: {', '.join(map(str, counted))}")
        return result
