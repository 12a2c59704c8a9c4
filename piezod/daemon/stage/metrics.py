"""The metrics of a stage as text, for Prometheus and programs like it.

Imported at the first scrape, because it needs prometheus-client. Names and units follow the
conventions of Prometheus; docs/monitoring.md explains the metrics.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import accumulate
from math import dist, hypot, nan
from typing import Any, Final, NamedTuple, TypeVar

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.exposition import generate_latest as generate_text
from prometheus_client.openmetrics.exposition import generate_latest as generate_openmetrics
from prometheus_client.registry import Collector, CollectorRegistry

import piezod
from piezod.config.faults import Fault
from piezod.config.model_file import ModelFile
from piezod.daemon.stage.connection import LoopConnection
from piezod.daemon.stage.status import STATES, masks, state_of
from piezod.devices.status import DeviceFlag
from piezod.messages.stores import Recording
from piezod.telemetry.cycle_counts import LIMITS, Histogram, counts_of
from piezod.telemetry.device_counts import device_counts_of
from piezod.telemetry.layout import enumerations
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S

_OF_MICRO: Final = 1e-6
_SECONDS, _OF_NANO = 1e-6, 1e-9
"""Units of the limits of a histogram of times, and of one of errors."""
T = TypeVar("T")

Labels = tuple[str, ...]
Rows = Iterable[tuple[Labels, float]]


class StageFacts(NamedTuple):
    """What the metrics tell of a stage, besides the shared memory."""

    name: str  #: Name of the stage.
    loop: LoopConnection  #: Connection to its loop.
    healthy: bool  #: Whether the loop runs cycles.
    cycle_age_s: float  #: Time since the supervisor saw a new cycle, in s.
    detections: Mapping[Fault, int]  #: How often each fault was detected since the daemon started.
    recording: Recording  #: Status of the running or the last recording.
    lease_held: bool  #: Whether a client has the lease.


def metrics_text(facts: StageFacts, *, openmetrics: bool) -> bytes:
    """Return all metrics, as OpenMetrics or in the older text format of Prometheus."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Families(facts))
    if not openmetrics:
        return generate_text(registry)
    text: bytes = generate_openmetrics(registry)  # type: ignore[no-untyped-call] # of the library
    return text


class _Families(Collector):
    """Makes the metrics; each has the label `stage`."""

    def __init__(self, facts: StageFacts) -> None:
        self._facts, self._loop = facts, facts.loop
        self._words, self._record = facts.loop.shared.words, facts.loop.latest()

    def collect(self) -> Iterator[Metric]:
        """Yield the metrics."""
        yield from self._stage()
        yield from self._faults()
        yield from self._cycles()
        yield from self._process()
        yield from self._devices()
        yield from self._axes()
        yield from self._learning()
        yield from self._operation()

    def _stage(self) -> Iterator[Metric]:
        facts = self._facts
        info = InfoMetricFamily("piezod_build", "Version of the daemon.", labels=("stage",))
        info.add_metric((facts.name,), {"version": piezod.__version__})
        yield info
        present = state_of(self._loop.shared, self._record)
        states = [((state.value,), state is present) for state in STATES]
        yield self._gauge("state", "1 for the state of the stage, 0 for others.", states, "state")
        yield self._gauge("healthy", "Whether the loop runs cycles.", [((), facts.healthy)])
        age = [((), facts.cycle_age_s)]
        yield self._gauge("cycle_age_seconds", "Time since the newest cycle was seen.", age)
        shadow = self._record is not None and self._record["shadow"]
        yield self._gauge("shadow", "Whether nothing is written.", [((), shadow)])

    def _faults(self) -> Iterator[Metric]:
        present, latched = masks(self._record) if self._record else (0, 0)
        for name, mask in (("present", present), ("latched", latched)):
            rows = [((fault.value,), mask >> i & 1) for i, fault in enumerate(Fault)]
            yield self._gauge(f"fault_{name}", f"Whether a fault is {name}.", rows, "fault")
        found = [((fault.value,), n) for fault, n in self._facts.detections.items()]
        text = "Detections of a fault since the daemon started."
        yield self._counter("fault_detections", text, found, "fault")

    def _cycles(self) -> Iterator[Metric]:
        words, counts = self._words, counts_of(self._loop.shared)
        period_s = self._loop.shared.layout.period_ns / NS_PER_S
        yield self._gauge("period_seconds", "Configured period of the loop.", [((), period_s)])
        cycles = {
            "cycles": ("Cycles of the loop.", words[Word.NEWEST_RECORD]),
            "healthy_cycles": ("Cycles on schedule.", words[Word.HEALTHY_CYCLES]),
            "late_cycles": ("Cycles that began late.", counts.late),
            "skipped_cycles": ("Periods without a cycle.", words[Word.SKIPPED_CYCLES]),
        }
        for name, (text, count) in cycles.items():
            yield self._counter(name, text, [((), count)])
        text = "Begin of a cycle after its deadline."
        rows = [((), counts.lateness)]
        yield self._histogram("cycle_lateness_seconds", text, rows, _SECONDS)
        text = "Time from the begin of a cycle to the end of its write."
        rows = [((), counts.duration)]
        yield self._histogram("cycle_duration_seconds", text, rows, _SECONDS)
        text = "Time in the devices, in all cycles."
        spent = (("read", counts.read_ns), ("write", counts.write_ns))
        phases = [((phase,), ns / NS_PER_S) for phase, ns in spent]
        yield self._counter("device_phase_seconds", text, phases, "phase")

    def _process(self) -> Iterator[Metric]:
        words = self._words
        faults = [(("minor",), words[Word.MINOR_FAULTS]), (("major",), words[Word.MAJOR_FAULTS])]
        yield self._counter("loop_page_faults", "Page faults of the loop.", faults, "kind")
        collections = [((), words[Word.GC_COLLECTIONS])]
        yield self._counter("loop_gc_collections", "Garbage collections.", collections)
        expired = [((), words[Word.REQUESTS_EXPIRED])]
        yield self._counter("requests_expired", "Requests that the loop took too late.", expired)
        steps = [((step["name"],), step["ok"]) for step in self._report("steps")]
        text = "Whether a real-time setting was obtained."
        yield self._gauge("realtime_step_ok", text, steps, "step")

    def _devices(self) -> Iterator[Metric]:
        found = device_counts_of(self._loop.shared, len(DeviceFlag))
        devices = dict(zip(self._loop.shared.layout.devices, found, strict=True))
        opened = [((), self._loop.devices_opened)]
        yield self._gauge("devices_open", "Whether the devices have been opened.", opened)
        exchanges = [((name,), each.exchanges) for name, each in devices.items()]
        text = "Exchanges on the bus, also failed ones; 0 for a device without a bus."
        yield self._counter("device_exchanges", text, exchanges, "device")
        faults = [
            ((name, flag.value), n)
            for name, each in devices.items()
            for flag, n in zip(DeviceFlag, each.faults, strict=True)
        ]
        text = "Faults of exchanges on the bus."
        yield self._counter("device_faults", text, faults, "device", "flag")
        rounds = [((name,), each.rounds) for name, each in devices.items()]
        text = "Rounds of a device behind a worker; 0 for a device in the cycle."
        yield self._counter("device_rounds", text, rounds, "device")
        times = [((name,), each.round_ns / NS_PER_S) for name, each in devices.items()]
        yield self._counter("device_round_seconds", "Time that its rounds took.", times, "device")
        trips = [
            ((each["name"], percentile), each["round_trip_us"][f"p{percentile}"] * 1e-6)
            for each in self._report("devices")
            for percentile in ("50", "99")
        ]
        text = "Round trip of a device, measured when the loop started."
        yield self._gauge("device_round_trip_seconds", text, trips, "device", "percentile")

    def _axes(self) -> Iterator[Metric]:
        axes = self._axis_records()
        for name in ("position", "command"):
            text = f"{name.capitalize()} in the newest cycle."
            values = {axis: one[f"{name}_um"] * _OF_MICRO for axis, one in axes.items()}
            for unit, rows in self._by_unit(values):
                yield self._gauge(f"axis_{name}_{unit}", text, rows, "axis")
        for name, what in (("drive_v", "drive"), ("read_back_v", "read_back")):
            rows = [((axis,), one[name]) for axis, one in axes.items()]
            text = f"{what.replace('_', '-').capitalize()} voltage in the newest cycle."
            yield self._gauge(f"axis_{what}_volts", text, rows, "axis")
        rows = [((axis,), one["on_target"]) for axis, one in axes.items()]
        yield self._gauge("axis_on_target", "Whether the target was reached.", rows, "axis")
        modes, limited = self._chosen("mode"), self._chosen("limited")
        yield self._gauge("axis_mode", "1 for the mode of an axis.", modes, "axis", "mode")
        text = "1 for what limits the drive."
        yield self._gauge("axis_drive_limited", text, limited, "axis", "limit")
        errors = counts_of(self._loop.shared).errors
        text = "Absolute value of command minus position, of all cycles."
        for unit, histograms in self._by_unit(dict(zip(self._loop.axes, errors, strict=True))):
            yield self._histogram(f"axis_error_{unit}", text, histograms, _OF_NANO, "axis")

    def _by_unit(self, of_axes: Mapping[str, T]) -> Iterator[tuple[str, list[tuple[Labels, T]]]]:
        """Yield rows of the axes in each unit, which the names of metrics end in."""
        for unit, word in (("µm", "meters"), ("µrad", "radians")):
            rows: list[tuple[Labels, T]] = [
                ((axis,), value)
                for axis, value in of_axes.items()
                if self._loop.config.unit(axis) == unit
            ]
            if rows or unit == "µm":  # before the first cycle there are no rows
                yield word, rows

    def _chosen(self, name: str) -> Rows:
        """Return a row for each axis and member of the enumeration of a field of its record."""
        return [
            ((axis, str(member.value)), one[name] == i)
            for axis, one in self._axis_records().items()
            for i, member in enumerate(enumerations()[name])
        ]

    def _learning(self) -> Iterator[Metric]:
        learned = {}
        for place, axis in enumerate(self._loop.axes):
            if (found := self._loop.learned.read(place)) is not None:
                learned[axis] = found
        text = "1 for the reason why an axis learns or pauses."
        yield self._gauge("axis_gate", text, self._chosen("gate"), "axis", "gate")
        models = self._loop.models
        moved = [((a,), _moved(models[a], each.weights)) for a, each in learned.items()]
        text = "Change of the weights since the model, relative to the model."
        yield self._gauge("axis_weights_moved_ratio", text, moved, "axis")
        limits = {a: axis.compensator.learned_pct for a, axis in self._loop.config.axes.items()}
        far = [((a,), each.distance) for a, each in learned.items()]
        text = "Difference of the drives of learned and identified model, relative to the range."
        yield self._gauge("axis_learned_ratio", text, far, "axis")
        bounds = [((a,), limit / 100.0) for a, limit in limits.items()]
        text = "Largest difference of these drives that is allowed, learned_pct."
        yield self._gauge("axis_learned_limit_ratio", text, bounds, "axis")
        for name in ("offset", "scale"):
            rows = [((axis,), getattr(each, name)) for axis, each in learned.items()]
            text = f"Learned {name} of the displacement, relative to the range; 0 for the model."
            yield self._gauge(f"axis_learned_{name}_ratio", text, rows, "axis")

    def _operation(self) -> Iterator[Metric]:
        facts, status = self._facts, self._facts.recording
        active = [((), status.recording)]
        yield self._gauge("recording_active", "Whether a recording is running.", active)
        text = "Records of the running or the last recording."
        yield self._gauge("recording_records", text, [((), status.records)])
        text = "Records that this recording lost."
        yield self._gauge("recording_lost_records", text, [((), status.lost)])
        text = "Whether a client has the lease."
        yield self._gauge("lease_held", text, [((), facts.lease_held)])

    def _axis_records(self) -> Mapping[str, Mapping[str, Any]]:
        """Return the records of the newest cycle by axis; empty before the first."""
        records = self._record["axes"] if self._record else ()
        return dict(zip(self._loop.axes, records, strict=False))

    def _report(self, name: str) -> Sequence[Mapping[str, Any]]:
        report: Mapping[str, Any] = self._loop.shared.report() or {}
        found: Sequence[Mapping[str, Any]] = report.get(name, ())
        return found

    def _gauge(self, name: str, text: str, rows: Rows, *labels: str) -> Metric:
        family = GaugeMetricFamily(f"piezod_{name}", text, labels=("stage", *labels))
        for values, value in rows:
            family.add_metric((self._facts.name, *values), value)
        return family

    def _counter(self, name: str, text: str, rows: Rows, *labels: str) -> Metric:
        family = CounterMetricFamily(f"piezod_{name}", text, labels=("stage", *labels))
        for values, value in rows:
            family.add_metric((self._facts.name, *values), value)
        return family

    def _histogram(
        self,
        name: str,
        text: str,
        rows: Iterable[tuple[Labels, Histogram]],
        unit: float,
        *labels: str,
    ) -> Metric:
        family = HistogramMetricFamily(f"piezod_{name}", text, labels=("stage", *labels))
        limits = [*(f"{limit * unit:.9g}" for limit in LIMITS), "+Inf"]
        for values, (buckets, total) in rows:
            below = [
                (limit, float(n)) for limit, n in zip(limits, accumulate(buckets), strict=True)
            ]
            family.add_metric((self._facts.name, *values), below, total * unit / 1000)
        return family


def _moved(model: ModelFile | None, weights: Sequence[float]) -> float:
    """Return the distance of weights from those of a model, relative to these; NaN if unknown."""
    if model is None:
        return nan
    stops = (*model.left_stop_weights, *model.right_stop_weights)
    before = stops or model.surface_coefficients
    if len(before) != len(weights) or not any(before):  # a model that was adopted just now
        return nan
    return dist(weights, before) / hypot(*before)
