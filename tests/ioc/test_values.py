"""What the records show."""

from math import isnan

import pytest

from piezod.config.states import State
from piezod.ioc.readings import FAULTY, OK, UNKNOWN, WARNING, Alarm, Reading
from piezod.ioc.table import STATES
from piezod.ioc.values import (
    History,
    alarm_of_state,
    of_axis,
    of_interval,
    of_recordings,
    of_status,
    text,
)
from piezod.messages.answers import Fault, Holder, Lease, Status
from piezod.messages.stores import Recordings, RunningRecording
from tests.ioc.fakes import axis, interval


def status(*faults: Fault, lease: Lease | None = None) -> Status:
    """Return a status with some faults."""
    return Status(
        state="SAFE",
        mode="trimmed",
        faults=faults,
        skipped_cycles=0,
        axes={},
        lease=lease,
    )


def fault(id: str, severity: str, *, present: bool = True) -> Fault:
    """Return a fault."""
    return Fault(id=id, name=f"name {id}", severity=severity, present=present, remedy="look")


def test_state_is_a_number_with_an_alarm() -> None:
    """The number is that of the choice in the table."""
    readings = of_interval(interval("HOLD"))

    assert readings["STATE"] == Reading(STATES.index("HOLD"), WARNING)
    assert readings["LOOP:SKIPPED"] == Reading(3)
    assert readings["LOOP:LATE"] == Reading(70.0)


@pytest.mark.parametrize("state", list(State))
def test_alarm_of_each_state(state: State) -> None:
    """A stage that is latched or stopped in an emergency is MAJOR, one that is held MINOR."""
    major = {State.FAULT, State.ESTOP, State.BLIND}
    minor = {State.HOLD, State.RAMP, State.STOPPING}

    assert alarm_of_state(state) == (
        FAULTY if state in major else WARNING if state in minor else OK
    )


def test_state_of_a_newer_daemon_is_an_alarm() -> None:
    """A state that this version does not know is MAJOR."""
    assert alarm_of_state("NEW") == FAULTY
    assert of_interval(interval("NEW"))["STATE"].alarm == FAULTY


def test_unknown_position_is_invalid() -> None:
    """It is INVALID with a sensor; without a sensor, and without a command, it is NaN only."""
    readings = of_axis(axis(None, None, command_um=None), has_sensor=True)
    without = of_axis(axis(None), has_sensor=False)

    assert readings["POS"].alarm == UNKNOWN
    assert readings["CMD"].alarm == readings["TARGET"].alarm == OK
    assert without["POS"].alarm == OK
    assert isinstance(without["POS"].value, float)
    assert isnan(without["POS"].value)


@pytest.mark.parametrize(
    ("severities", "alarm"),
    [((), OK), (("info",), OK), (("info", "warning"), WARNING), (("warning", "error"), FAULTY)],
)
def test_faults_have_the_alarm_of_the_worst(severities: tuple[str, ...], alarm: Alarm) -> None:
    """It is that of the list and of the group."""
    faults = [fault(f"B{i}", severity) for i, severity in enumerate(severities, 1)]
    readings = of_status(status(*faults))

    assert readings["FAULTS"].alarm == readings["FAULT:BUS"].alarm == alarm
    assert readings["FAULT:SENSOR"] == Reading("")
    assert readings["FAULT:COUNT"].value == len(severities)


def test_worst_fault_is_named_with_its_remedy() -> None:
    """An error that is present comes before one that is latched, and before warnings."""
    faults = fault("D1", "warning"), fault("S2", "error", present=False), fault("A3", "error")
    readings = of_status(status(*faults))

    assert readings["FAULTS"].value == "A3 S2 D1"
    assert readings["FAULT:TEXT"].value == "A3 name A3: look"


def test_lease() -> None:
    """The holder is the user and the client; nobody is an empty text."""
    held = Lease(holder=Holder(user="ann", uid=1, client="ioc"), expires_in_s=3.0)

    assert of_status(status(lease=held))["LEASE:HOLDER"].value == "ann ioc"
    assert of_status(status())["LEASE:HOLDER"].value == ""


def test_recording() -> None:
    """Lost cycles are MINOR; without a recording all is empty."""
    running = RunningRecording(name="scan", records=7, lost=2)
    readings = of_recordings(Recordings(running=running, recordings=()))
    nothing = of_recordings(Recordings(running=None, recordings=()))

    assert readings["REC:LOST"] == Reading(2, WARNING)
    assert (readings["REC:NAME"].value, readings["REC:RUNNING"].value) == ("scan", True)
    assert (nothing["REC:NAME"].value, nothing["REC:RECORDS"]) == ("", Reading(0))


def test_history_is_one_second() -> None:
    """Points older than a second are left out, and times count from the newest point."""
    history = History()
    for i in range(150):
        history.feed(i * 0.02, axis(float(i), command_um=None))
    readings = {name: each.value for name, each in history.readings().items()}
    times, positions = readings["HIST:TIME"], readings["HIST:POS"]

    assert isinstance(times, list)
    assert isinstance(positions, list)
    assert len(times) == len(positions) == 50
    assert times[0] == pytest.approx(-0.98)
    assert (times[-1], positions[-1]) == (0.0, 149.0)


def test_texts_fit() -> None:
    """Texts are ASCII, and end in dots where they are too long."""
    assert text("12 µm") == "12 um"
    assert text("x" * 50, 39) == "x" * 36 + "..."
