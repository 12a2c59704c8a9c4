"""What the stores of a stage tell: configuration, parameters, recordings, audit."""

from dataclasses import dataclass

from piezod.messages.documents import Document, Message


@dataclass(frozen=True)
class Reloaded(Message):
    """A configuration that has been read again and is in force.

    Attributes:
        changes: Paths of the values that have changed, for example "axes.x.speed_um_per_s".
        lost: What has been lost of the parameters in use, each with its remedy; usually nothing.
    """

    changes: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Parameters(Message):
    """The parameters in use.

    Attributes:
        sequence: Number under which they were saved last, None if they were never saved.
        axes: Parameters of each axis, by the name of the axis, with the keys of the daemon.
    """

    sequence: int | None = None
    axes: dict[str, Document]


@dataclass(frozen=True)
class Saved(Message):
    """Saved parameters.

    Attributes:
        sequence: Their number, larger for later ones.
    """

    sequence: int


@dataclass(frozen=True)
class Rejected:
    """A file of parameters that was not used.

    Attributes:
        file: Its name.
        why: What is wrong with it.
    """

    file: str
    why: str


@dataclass(frozen=True)
class Loaded(Saved):
    """Saved parameters that are in use from now on.

    Attributes:
        sequence: Their number.
        copy: Which file they are from: "newest" or "number 7".
        rejected: Newer files that were skipped, newest first.
    """

    copy: str = ""
    rejected: tuple[Rejected, ...] = ()


@dataclass(frozen=True)
class HistoryEntry:
    """Saved parameters in the history.

    Attributes:
        sequence: Their number.
        saved_at: Time, ISO 8601.
        saved_by: User.
        axes: Names of the axes.
        why: Why they cannot be used; empty if they can.
    """

    sequence: int
    saved_at: str = ""
    saved_by: str = ""
    axes: tuple[str, ...] = ()
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class History(Message):
    """All saved parameters.

    Attributes:
        history: Newest first.
    """

    history: tuple[HistoryEntry, ...]


@dataclass(frozen=True)
class RecordingFile:
    """A file of a finished recording.

    Attributes:
        name: Name, from the daemon.
        size_bytes: Size in bytes.
        kept: Whether it stays when old recordings are removed.
    """

    name: str
    size_bytes: int = 0
    kept: bool = False


@dataclass(frozen=True)
class Recording(Message):
    """A recording that was started or ended.

    Attributes:
        recording: Whether it is in progress.
        name: Name; empty if there was none yet.
        records: Number of recorded cycles.
        lost: Number of cycles that were overwritten before the disk took them.
        why: Why it ended by itself; empty if it did not.
        disk_full: Whether it ended by itself because the disk was full.
        files: Number of its files; the names of all but the first one end in their number.
    """

    recording: bool = False
    name: str = ""
    records: int = 0
    lost: int = 0
    why: str = ""
    disk_full: bool = False
    files: int = 1


@dataclass(frozen=True)
class RunningRecording(Recording):
    """The recording in progress.

    Attributes:
        file: Name of the file that is being written.
    """

    file: str = ""


@dataclass(frozen=True)
class KeptRecording(Message):
    """A recording that was marked, or whose mark was removed.

    Attributes:
        name: Name.
        kept: Whether it is marked as kept.
    """

    name: str
    kept: bool


@dataclass(frozen=True, kw_only=True)
class Recordings(Message):
    """All recordings.

    Attributes:
        running: The recording in progress, None if there is none.
        recordings: The files of finished recordings.
        folder: Their folder on the machine of the daemon.
    """

    running: RunningRecording | None
    recordings: tuple[RecordingFile, ...]
    folder: str = ""


@dataclass(frozen=True)
class AuditLine:
    """One request and its answer.

    Attributes:
        when: Time, ISO 8601 with the offset from UTC.
        uid: Number of the user.
        user: Name of the user; empty if it has none.
        client: Name that the client gives itself.
        what: The request, as in "goto x 12.5 µm".
        accepted: Whether it was accepted.
        why: Why not; empty if it was accepted.
    """

    when: str
    uid: int
    user: str
    client: str
    what: str
    accepted: bool
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class Audit(Message):
    """Who requested what.

    Attributes:
        audit: Newest first.
    """

    audit: tuple[AuditLine, ...]
