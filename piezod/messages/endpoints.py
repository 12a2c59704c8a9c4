"""The table of commands: its columns, and the rows of endpoints that need no request class.

The rows of requests stand beside the request classes in `piezod.messages.requests`, which joins all
rows to `TABLE`. Routes, roles, clients, the command line and docs/client.md derive from it. This
module imports nothing heavy, because clients and `piezod --help` import it.
"""

import builtins
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    from pydantic import BaseModel

SMALL_BODY: Final = 1024
LARGE_BODY: Final = 256 * 1024
"""For points of a waveform and for models."""
CURVES_BODY: Final = 1024 * 1024
"""For the curves of a scan; in the mailbox they take a quarter of it."""
_ANSWERS: Final = ("answers", "stores", "telemetry")
"""Modules of the classes of answers."""
ANSWER_WITHIN_S: Final = 10.0
"""How long clients wait for most answers, in s."""


class Role(IntEnum):
    """The role of a user; a larger one includes the rights of all smaller ones."""

    VIEWER = 1
    """Look."""
    OPERATOR = 2
    """Arm, move, stop, reset, record and save."""
    ENGINEER = 3
    """Identify, change model and configuration, end the faults of an engineer, shut down."""


class Access(NamedTuple):
    """What an endpoint requires and allows."""

    role: Role  #: The least role that may use it.
    lease: bool = False  #: Whether it needs the lease, and renews it.
    urgent: bool = False  #: Whether limits of rate and connections do not apply.
    most_bytes: int = SMALL_BODY  #: Largest body, in bytes.


LOOK: Final = Access(Role.VIEWER)
TOWARDS_SAFETY: Final = Access(Role.OPERATOR, urgent=True)
EMERGENCY: Final = Access(Role.VIEWER, urgent=True)
WITH_LEASE: Final = Access(Role.OPERATOR, lease=True)
WITH_LEASE_BY_POINTS: Final = Access(Role.OPERATOR, lease=True, most_bytes=LARGE_BODY)
KEEP: Final = Access(Role.OPERATOR)
CHANGE: Final = Access(Role.ENGINEER, lease=True)
CHANGE_BY_POINTS: Final = Access(Role.ENGINEER, lease=True, most_bytes=LARGE_BODY)
CHANGE_BY_CURVES: Final = Access(Role.ENGINEER, lease=True, most_bytes=CURVES_BODY)
END: Final = Access(Role.ENGINEER)


class Group(StrEnum):
    """The headings of `piezod --help` and docs/client.md, in their order."""

    LOOK = "Look at a stage"
    OPERATE = "Put a stage into operation"
    MOVE = "Move a stage"
    STOP = "Stop a stage, and recover"
    STORES = "Parameters, recordings and configuration"


@dataclass(frozen=True)
class Endpoint:
    """One row of the table of commands."""

    name: str  #: Name of the method of both clients; for requests also their `kind`.
    method: str  #: HTTP method.
    path: str  #: Path below `/v1/`.
    access: Access  #: Who may use it, and under which limits.
    help: str  #: First line and details, for the command line, OpenAPI and docs/client.md.
    #: Heading under which help lists the verb; None if the command line has none.
    group: Group | None = None
    verb: str = ""  #: Words after `piezod`; empty if the command line has none.
    done: str = ""  #: What the command line prints when the request is accepted.
    #: Model of the body of a request to the loop; None for all other endpoints.
    request: "type[BaseModel] | None" = None
    #: Whether the body is a stream of lines, which the endpoint reads itself.
    streamed: bool = False
    #: Name of the class of the answer, of each event for telemetry; "dict" for a document without a
    #: class, "str" for a text, empty for a file.
    answer: str = ""
    also_fine: int = 200  #: HTTP status that is no error.
    #: Longest time that a client waits for the answer, in s.
    answer_within_s: float = ANSWER_WITHIN_S

    @property
    def answer_class(self) -> type | None:
        """Class of the answer; None for a file."""
        # Imported at the first use: `piezod --help` has no time for classes that it does not need.
        modules = (import_module(f"piezod.messages.{name}") for name in _ANSWERS)
        found = (getattr(each, self.answer, None) for each in (builtins, *modules))
        return next(filter(None, found), None) if self.answer else None


def _get(
    name: str,
    answer: str,
    help: str,
    group: Group | None = None,
    verb: str = "",
    **more: Any,
) -> Endpoint:
    shown = {"help": help, "group": group, "verb": verb, "answer": answer}
    return Endpoint(name, "GET", **{"path": name, "access": LOOK, **shown, **more})


def _post(
    name: str, path: str, answer: str, access: Access, help: str, verb: str = "", **more: Any
) -> Endpoint:
    group = Group.STORES if verb else None
    return Endpoint(name, "POST", path, access, help, group, verb, answer=answer, **more)


_ROWS: Final = (
    _get("status", "Status", "Show state, mode, faults and each axis.", Group.LOOK, "status"),
    _get("faults", "Faults", "List the faults, with their remedies.", Group.LOOK, "faults"),
    _get(
        "telemetry",
        "Telemetry",
        "Show a stage as it moves.\n\nEach update has the minimum, the maximum and the last value "
        "of all cycles since the update before, so that no spike is lost. `piezod watch` shows "
        "error and drive of the last 30 s, timing, and faults with their remedies. It prints one "
        "line per update if stdout is no terminal, and ends with Ctrl-C.",
        Group.LOOK,
        "watch",
    ),
    _get(
        "metrics",
        "str",
        "Print the metrics for Prometheus.\n\nThe text is in the format of the textfile collector "
        "of node_exporter. Over HTTP it is OpenMetrics, or that format for a client that accepts "
        "only `text/plain`.",
        Group.LOOK,
        "metrics",
    ),
    Endpoint(
        "stream",
        "POST",
        "stream",
        WITH_LEASE,
        "Follow setpoints of another program, one line of JSON each.\n\nA line such as "
        '{"x": 12.5} has a position in µm for each axis and takes effect when it arrives, at up to '
        "some thousand lines per second. The command line reads the lines from stdin. If no line "
        "arrives for 0.1 s, or 5 cycles if that is longer, the stage goes to HOLD; `resume` before "
        "the next movement.",
        Group.MOVE,
        "stream",
        streamed=True,
        answer="StreamEnd",
    ),
    _get(
        "health",
        "Health",
        "Return whether the loop runs cycles, with HTTP status 503 if not.",
        also_fine=503,
    ),
    _get(
        "realtime",
        "Realtime",
        "Return the real-time settings that the loop requested and obtained.",
    ),
    _get("played", "dict", "Return the record of the last play.", path="play"),
    _get(
        "scanned",
        "dict",
        "Return the last scan: its state, and the samples of some sweeps from `first` on.",
        path="scan",
    ),
    _get(
        "config",
        "dict",
        "Return the configuration in force.\n\nIt is followed by what the daemon makes of it: each "
        "axis has the positions that may be commanded as `command_range_um`, and `longest_move_s` "
        "has for each axis how long a movement over all of them takes, in s.",
    ),
    _get("audit", "Audit", "Return who requested what, newest first.", access=KEEP),
    _get("openapi", "dict", "Return this description."),
    _post(
        "renew_lease",
        "lease",
        "Lease",
        WITH_LEASE,
        "Take or renew the lease for 30 s, as each command does.",
    ),
    _post(
        "session",
        "session",
        "Lease",
        WITH_LEASE,
        "Take the lease until this connection closes.\n\nThen the daemon stops the stage and ends "
        "a recording that this client has started.",
    ),
    Endpoint(
        "release_lease",
        "DELETE",
        "lease",
        KEEP,
        "Release the lease for other clients.",
        answer="Released",
    ),
    _get("params", "Parameters", "Show the parameters in use.", Group.STORES, "params list"),
    _post(
        "save_params",
        "params/save",
        "Saved",
        KEEP,
        "Save the parameters in use, for the next start too.\n\nOffset and scale are saved for "
        "inspection only and not restored, because they drift within a day.",
        "params save",
    ),
    _post(
        "load_params",
        "params/load",
        "Loaded",
        CHANGE,
        "Use the newest saved parameters; only while disarmed.",
        "params load",
    ),
    _post(
        "restore_params",
        "params/restore",
        "Loaded",
        CHANGE,
        "Use earlier saved parameters; only while disarmed.",
        "params restore",
    ),
    _get(
        "params_history",
        "History",
        "List the saved parameters, newest first.",
        Group.STORES,
        "params history",
        path="params/history",
    ),
    _post(
        "start_recording",
        "recordings/start",
        "Recording",
        KEEP,
        "Start recording every cycle.",
        "record start",
    ),
    _post(
        "stop_recording",
        "recordings/stop",
        "Recording",
        KEEP,
        "End the recording, close its file.",
        "record stop",
    ),
    _get("recordings", "Recordings", "List the recordings.", Group.STORES, "record list"),
    _post(
        "keep_recording",
        "recordings/keep",
        "KeptRecording",
        KEEP,
        "Keep a recording when old ones are removed.\n\nThe daemon removes the oldest files if the "
        "configuration limits their size with `recordings.max_total_mb`.",
        "record keep",
    ),
    _get(
        "fetch_recording",
        "",
        "Copy a finished recording, an HDF5 file.",
        Group.STORES,
        "record get",
        path="recordings/{name}",
    ),
    _post(
        "reload",
        "reload",
        "Reloaded",
        CHANGE,
        "Make the daemon read its configuration again.\n\n"
        "If the configuration is not valid, nothing changes. Sensor zeros and learned weights "
        "stay, except the weights of an axis whose model file has changed. Offset and scale begin "
        "at zero.",
        "reload",
        answer_within_s=150.0,  # it compiles and starts a loop, and the old one again if that fails
    ),
)
ENDPOINTS: Final[Mapping[str, Endpoint]] = {row.name: row for row in _ROWS}
"""The rows without a request class, by name."""
