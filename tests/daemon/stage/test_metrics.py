"""The metrics of a stage, read with the parsers of the Prometheus client."""

from math import nan

import pytest
from prometheus_client import Metric
from prometheus_client.openmetrics.parser import text_string_to_metric_families as openmetrics
from prometheus_client.parser import text_string_to_metric_families as plain_text

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.daemon.supervisor.housekeeping import Housekeeping
from piezod.devices.status import DeviceFlag
from piezod.telemetry.cycle_counts import CycleCounter
from piezod.telemetry.device_counts import DeviceCounts, put_device_counts
from piezod.telemetry.events import EventWriter
from piezod.telemetry.learned_writer import LearnedWriter
from piezod.telemetry.record import StageEvent
from piezod.telemetry.words import Word
from tests.daemon.bench import PEER, Bench

LATE_NS = 500_000
PARSERS = {True: openmetrics, False: plain_text}


def families(
    bench: Bench, *, as_openmetrics: bool = True, lease_held: bool = False
) -> list[Metric]:
    """Return the metrics, as a parser reads them."""
    text = bench.link.metrics(lease_held=lease_held, openmetrics=as_openmetrics).decode()
    return list(PARSERS[as_openmetrics](text))


def value(bench: Bench, name: str, **labels: str) -> float:
    """Return the value of the only sample with a name and labels."""
    (found,) = (
        sample.value
        for family in families(bench)
        for sample in family.samples
        if sample.name == name and labels.items() <= sample.labels.items()
    )
    return found


def test_metrics_follow_the_conventions(bench: Bench) -> None:
    """Each metric has a help text and a type, and each sample has the name of the stage."""
    found = families(bench)

    assert len(found) > 40
    assert [each.name for each in found if not each.documentation.endswith(".")] == []
    assert {each.type for each in found} == {"info", "gauge", "counter", "histogram"}
    assert {sample.labels["stage"] for each in found for sample in each.samples} == {"rig"}
    assert all(each.name.startswith("piezod_") for each in found)


def test_both_formats_have_the_same_values(bench: Bench) -> None:
    """A textfile collector gets the same values as a program that reads OpenMetrics."""
    bench.record(State.RUN, position_um=3.0, command_um=3.1, drive_v=20.0, read_back_v=20.1)
    found = [
        {
            (sample.name, *sample.labels.items()): sample.value
            for family in families(bench, as_openmetrics=as_openmetrics)
            for sample in family.samples
            if sample.name != "piezod_cycle_age_seconds"
        }
        for as_openmetrics in (True, False)
    ]

    assert found[0] == found[1]


def test_before_the_first_cycle_there_are_no_axis_values(bench: Bench) -> None:
    """The state is BOOT, and an axis without a record has no position."""
    assert value(bench, "piezod_state", state="BOOT") == 1
    assert value(bench, "piezod_healthy") == 0
    assert [
        each.samples for each in families(bench) if each.name == "piezod_axis_position_meters"
    ] == [[]]


def test_state_mode_and_positions_are_those_of_the_newest_cycle(bench: Bench) -> None:
    """Values are in base units; one state and one mode is 1."""
    bench.record(State.RUN, position_um=3.0, command_um=3.1, drive_v=20.0, read_back_v=nan)
    states = [value(bench, "piezod_state", state=each.value) for each in State]
    modes = [value(bench, "piezod_axis_mode", axis="x", mode=each.value) for each in Mode]

    assert (states.index(1), sum(states)) == (list(State).index(State.RUN), 1)
    assert (modes.index(1), sum(modes)) == (list(Mode).index(Mode.ADAPTIVE), 1)
    assert value(bench, "piezod_axis_position_meters", axis="x") == pytest.approx(3.0e-6)
    assert value(bench, "piezod_axis_drive_volts", axis="x") == 20.0
    assert value(bench, "piezod_axis_gate", axis="x", gate="learning") == 1


def test_a_fault_is_counted_and_shown(bench: Bench) -> None:
    """A fault is shown while it is present or latched; its detections are counted."""
    bit = 1 << list(Fault).index(Fault.P6)
    before = value(bench, "piezod_fault_detections_total", fault="P6")
    events = EventWriter(bench.loop.shared)
    for kind, fault in (("fault", "P6"), ("fault-cleared", "P6"), ("fault", "P6"), ("state", "")):
        events.append(StageEvent(1, "error", kind, "full", fault))
    bench.record(State.RUN, bit, latched=bit)
    Housekeeping(bench.link).log_events()

    assert before == 0
    assert value(bench, "piezod_fault_detections_total", fault="P6") == 2
    assert value(bench, "piezod_fault_present", fault="P6") == 1
    assert value(bench, "piezod_fault_latched", fault="P6") == 1
    assert value(bench, "piezod_fault_present", fault="S1") == 0


def test_late_and_skipped_cycles_are_counted(bench: Bench) -> None:
    """A late cycle is in the counter, and in the buckets from its lateness on."""
    counter = CycleCounter(bench.loop.shared, LATE_NS)
    counter.cycle(700_000, 0, read_ns=20_000, write_ns=5_000, busy_ns=60_000)
    counter.cycle(1_000, 0, read_ns=20_000, write_ns=5_000, busy_ns=60_000)
    bench.loop.shared.words[Word.SKIPPED_CYCLES] = 4
    lateness = "piezod_cycle_lateness_seconds"

    assert value(bench, "piezod_late_cycles_total") == 1
    assert value(bench, "piezod_skipped_cycles_total") == 4
    assert value(bench, f"{lateness}_bucket", le="1e-06") == 1
    assert value(bench, f"{lateness}_bucket", le="0.000512") == 1
    assert value(bench, f"{lateness}_bucket", le="0.001024") == 2
    assert value(bench, f"{lateness}_count") == 2
    assert value(bench, f"{lateness}_sum") == pytest.approx(701e-6)
    assert value(bench, "piezod_cycle_duration_seconds_sum") == pytest.approx(120e-6)
    assert value(bench, "piezod_device_phase_seconds_total", phase="read") == pytest.approx(40e-6)


def test_errors_are_in_meters(bench: Bench) -> None:
    """The histogram of the error has the values of all cycles."""
    counter = CycleCounter(bench.loop.shared, LATE_NS)
    for error_um in (0.003, -0.1):
        counter.error(0, error_um)

    assert value(bench, "piezod_axis_error_meters_bucket", axis="x", le="4e-09") == 1
    assert value(bench, "piezod_axis_error_meters_sum", axis="x") == pytest.approx(103e-9)


def test_devices_have_their_faults_and_round_trips(bench: Bench) -> None:
    """Exchanges and faults are those that the loop published, round trips those of its report."""
    faults = [7 * (flag is DeviceFlag.BAD_CHECKSUM) for flag in DeviceFlag]
    put_device_counts(bench.loop.shared, 0, DeviceCounts(90, 30, 6_000_000, faults))
    (name,) = bench.loop.shared.layout.devices
    trips = {"name": name, "round_trip_us": {"p50": 250.0, "p99": 400.0}}
    steps = [{"name": "memory", "ok": False}]
    bench.loop.shared.set_report({"steps": steps, "devices": [trips]})
    of = {"device": name}

    assert value(bench, "piezod_device_exchanges_total", **of) == 90
    assert value(bench, "piezod_device_faults_total", **of, flag="bad checksum") == 7
    assert value(bench, "piezod_device_round_seconds_total", **of) == pytest.approx(6e-3)
    assert value(bench, "piezod_device_round_trip_seconds", **of, percentile="99") == pytest.approx(
        4e-4
    )
    assert value(bench, "piezod_realtime_step_ok", step="memory") == 0


def test_learning_shows_how_far_the_weights_have_moved(bench: Bench) -> None:
    """The change is relative to the model, which the daemon has adopted."""
    model = bench.loop.models["x"]
    assert model is not None
    weights = [*model.left_stop_weights, *model.right_stop_weights]
    publish = LearnedWriter(bench.loop.shared).publish
    publish(0, (weights, 0.01, 1.2, 0.0, False, 0.0, 0.0, 26.0))
    before = value(bench, "piezod_axis_weights_moved_ratio", axis="x")
    publish(0, ([1.1 * each for each in weights], 0.01, 1.2, 0.0, False, 0.03, 0.0, 26.0))

    assert before == 0
    assert value(bench, "piezod_axis_weights_moved_ratio", axis="x") == pytest.approx(0.1)
    assert value(bench, "piezod_axis_learned_scale_ratio", axis="x") == 1.2
    assert value(bench, "piezod_axis_learned_ratio", axis="x") == 0.03
    assert value(bench, "piezod_axis_learned_limit_ratio", axis="x") == 0.05


def test_recording_and_lease(bench: Bench) -> None:
    """The metrics show whether a recording is running and whether a client has the lease."""
    before = value(bench, "piezod_recording_active")
    bench.do(lambda link: link.start_recording(None, PEER))
    during = value(bench, "piezod_recording_active")
    bench.do(lambda link: link.stop_recording(PEER))
    (lease,) = (
        sample.value
        for each in families(bench, lease_held=True)
        for sample in each.samples
        if each.name == "piezod_lease_held"
    )

    assert (before, during) == (0, 1)
    assert value(bench, "piezod_lease_held") == 0
    assert lease == 1
