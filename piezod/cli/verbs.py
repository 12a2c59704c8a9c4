"""The list of commands: where each is, and its first sentence for help.

The texts of verbs that stand in the table of commands come from there; those of all others are the
docstrings of their functions, whose first sentences are repeated here. `piezod --help` has no time
to import the request classes, so it reads their docstrings and rows in the text of their module.
"""

import ast
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from piezod.cli.lazy import PLAIN, Verb
from piezod.messages import endpoints
from piezod.messages.endpoints import Group

SEVERAL: Final = "Several stages"
"""Heading of the commands for all stages of this machine."""
OWN: Final[Mapping[str, Sequence[tuple[str, str, str]]]] = {
    "Experiments and models": (
        (
            "demo",
            "experiment.demo",
            "Run the experiment of the paper on a simulated stage and write a report.",
        ),
        (
            "experiment",
            "experiment.experiment",
            "Run an experiment in virtual time and write a report.",
        ),
        ("import", "identify.import_record:import_record", "Show how a record of others is read."),
        ("identify", "identify.identify", "Fit the inverse model to recorded data."),
        (
            "voltages",
            "inverse.voltages",
            "Compute the voltages with which a stage follows a trajectory.",
        ),
        (
            "export-code",
            "inverse.export_code",
            "Write the inverse of a model as one file of C or MATLAB, with a self-test.",
        ),
        (
            "response",
            "identify.response",
            "Measure the frequency response of an axis: gain, delay and modes.",
        ),
        (
            "play",
            "experiment.play",
            "Play a periodic waveform on a running stage, from a table that the device plays by "
            "its clock.",
        ),
        (
            "scan",
            "experiment.scan",
            "Scan lines, a raster or a stack, and store a picture.",
        ),
        (
            "check",
            "experiment.check",
            "Validate the configuration of a stage, an experiment, a model, response or groups "
            "file.",
        ),
    ),
    "Recordings": (
        ("plot", "record.plot", "Draw a recording, a scan, or a model."),
        ("export", "record.export", "Write a recording as CSV or Parquet."),
        ("replay", "record.replay", "Run the control law again on a recording."),
    ),
    "Devices": (
        (
            "drivers",
            "devices.drivers",
            "List the installed drivers, and what each of their profiles was checked against.",
        ),
        (
            "emulate",
            "devices.emulate",
            "Emulate devices until Ctrl-C, connected to a simulated rig.",
        ),
        (
            "probe",
            "devices.probe",
            "Inspect the devices of a stage; moves nothing without --wiggle.",
        ),
        (
            "commission",
            "devices.commission",
            "Measure an axis: identity, noise, polarity, travel, delay, first mode.",
        ),
        (
            "acceptance",
            "devices.acceptance",
            "Write a signed record of what was tried with a device; moves nothing.",
        ),
    ),
    "Daemon of a stage": (
        (
            "init",
            "daemon.init",
            "Write the example configurations: stages, their models, experiments.",
        ),
        (
            "compile",
            "daemon.compile:compile_kernels",
            "Compile the kernels of the loop for this processor, before the first start.",
        ),
        ("run", "daemon.run", "Run the daemon of a stage until Ctrl-C or SIGTERM."),
        ("safe", "daemon.safe", "Ramp a stage to its safe voltage after its daemon has died."),
        (
            "web",
            "daemon.web",
            "Serve a page with all stages of this machine, and their API, until Ctrl-C.",
        ),
        ("gcs", "daemon.gcs", "Serve the running stage as a PI GCS 2 controller until Ctrl-C."),
        (
            "ioc",
            "daemon.ioc",
            "Serve the running stages as EPICS records (CA and PVA) until Ctrl-C.",
        ),
        (
            "install-service",
            "daemon.install_service",
            "Install the systemd service of the daemon on this machine; needs root.",
        ),
    ),
    SEVERAL: (
        ("list", "look.list_stages:list_running", "List the running stages of this machine."),
        ("group status", "group.group", "List the stages of a group as `piezod list` does."),
        ("group arm", "group.group", "Arm all stages of a group."),
        ("group goto", "group.waves", "Move stages to positions."),
        ("group wave", "group.waves", "Follow waveforms that begin together."),
        ("group play", "group.waves", "Play tables that begin together."),
        ("group hold", "group.group", "Hold the voltages of all stages."),
        ("group resume", "group.group", "Continue on all stages after a hold."),
        ("group disarm", "group.group", "Ramp to the safe voltages, then write nothing more."),
        ("group stop", "group.group", "Ramp all stages to their safe voltages."),
        ("group estop", "group.group", "Stop all stages in an emergency."),
        (
            "group record start",
            "group.record",
            "Start a recording of each stage; time 0 of all files is the same instant.",
        ),
        ("group record stop", "group.record", "End the recording of each stage."),
    ),
}
"""Commands that are no verbs of the table of commands, by their headings, and their modules."""
_OF_FILES: Final = (
    ("record show", "record.show", "Print what is in a recording."),
    *((f"record {words}", place, help) for words, place, help in OWN["Recordings"]),
    ("record repair", "record.record", "Make recordings open plainly whose daemon was killed."),
)
"""Commands of the family `record` that need no daemon."""
FAMILIES: Final[Mapping[str, str]] = {
    "group": "Operate several stages of this machine as one.\n\nA file names the stages of each "
    "group. A request that one stage refuses is taken back on the others.",
    "group record": "Record all stages of a group.",
    "params": "List, save and restore learned parameters.\n\nOffset and scale are saved and not "
    "restored, because they drift within a day.",
    "record": "Record every cycle; list, show, copy and use recordings.",
}
"""Help of the families of commands, by the words that their commands begin with."""
_PLACES: Final[Mapping[str, str]] = {
    "status": "look.status",
    "faults": "look.status",
    "watch": "look.watch",
    "metrics": "look.metrics",
    "arm": "move.operation",
    "mode": "move.operation",
    "goto": "move.motion",
    "path": "move.motion",
    "wave": "move.motion",
    "stream": "move.stream",
    "reset": "move.operation",
    "params list": "daemon.params:list_params",
    "params save": "daemon.params",
    "params load": "daemon.params",
    "params restore": "daemon.params",
    "params history": "daemon.params",
    "record start": "record.record",
    "record stop": "record.record",
    "record list": "record.record:list_records",
    "record keep": "record.record",
    "record get": "record.record",
    "reload": "daemon.reload",
}
"""Verbs of the table of commands with functions of their own; all others only send a request."""


class _Row(NamedTuple):
    """A row of the table of commands, as far as help needs it."""

    verb: str
    group: Group | None
    help: str


def _rows_of_requests() -> Iterator[_Row]:
    """Yield the rows that have a request class, from the text of the module of these classes."""
    source = Path(endpoints.__file__).with_name("requests.py").read_text(encoding="utf-8")
    module = ast.parse(source)
    classes = {each.name: each for each in module.body if isinstance(each, ast.ClassDef)}
    for call in ast.walk(module):
        match call:
            case ast.Call(
                func=ast.Name(id="_row"),
                args=[ast.Name(id=name), _, ast.Attribute(value=ast.Name(id="Group"), attr=group)],
            ):
                yield _Row(
                    _kind(classes[name]), Group[group], ast.get_docstring(classes[name]) or ""
                )


def _kind(request: ast.ClassDef) -> str:
    """Return the default of the field `kind` of a request class."""
    for field in request.body:
        match field:
            case ast.AnnAssign(target=ast.Name(id="kind"), value=ast.Constant(value=str(kind))):
                return kind
    raise ValueError(f"{request.name} has no field `kind` with a text")


def _verbs() -> Iterator[Verb]:
    """Yield all commands by their headings; verbs of one word come before families."""
    for heading, verbs in OWN.items():
        for words, place, help in verbs:
            yield Verb(words, heading, help, place)
    others = (_Row(row.verb, row.group, row.help) for row in endpoints.ENDPOINTS.values())
    rows = [*_rows_of_requests(), *others]
    for group in Group:
        for row in sorted(rows, key=lambda row: " " in row.verb):
            if row.group is group:
                yield Verb(row.verb, group, row.help, _PLACES.get(row.verb, PLAIN), in_table=True)
    for words, place, help in _OF_FILES:
        yield Verb(words, Group.STORES, help, place)


VERBS: Final[Mapping[str, Verb]] = {verb.words: verb for verb in _verbs()}
"""All commands, by their words, in the order of `piezod --help`."""
