"""What the stores of a stage tell: configuration, parameters, recordings, audit."""

from dataclasses import dataclass

from piezod.messages.documents import Document, Message


@dataclass(frozen=True)
class Reloaded(Message):
    """A configuration that has been read again and is in force."""

    #: Paths of the values that have changed, for example "axes.x.speed_um_per_s".
    changes: tuple[str, ...] = ()
    #: What has been lost of the parameters in use, each with its remedy; usually nothing.
    lost: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Parameters(Message):
    """The parameters in use."""

    #: Number under which they were saved last, None if they were never saved.
    sequence: int | None = None
    #: Parameters of each axis, by the name of the axis, with the keys of the daemon.
    axes: dict[str, Document]


@dataclass(frozen=True)
class Saved(Message):
    """Saved parameters."""

    sequence: int  #: Their number, larger for later ones.


@dataclass(frozen=True)
class Rejected:
    """A file of parameters that was not used."""

    file: str  #: Its name.
    why: str  #: What is wrong with it.


@dataclass(frozen=True)
class Loaded(Saved):
    """Saved parameters that are in use from now on."""

    copy: str = ""  #: Which file they are from: "newest" or "number 7".
    rejected: tuple[Rejected, ...] = ()  #: Newer files that were skipped, newest first.


@dataclass(frozen=True)
class HistoryEntry:
    """Saved parameters in the history."""

    sequence: int  #: Their number.
    saved_at: str = ""  #: Time, ISO 8601.
    saved_by: str = ""  #: User.
    axes: tuple[str, ...] = ()  #: Names of the axes.
    why: str = ""  #: Why they cannot be used; empty if they can.


@dataclass(frozen=True, kw_only=True)
class History(Message):
    """All saved parameters."""

    history: tuple[HistoryEntry, ...]  #: Newest first.


@dataclass(frozen=True)
class RecordingFile:
    """A file of a finished recording."""

    name: str  #: Name, from the daemon.
    size_bytes: int = 0  #: Size in bytes.
    kept: bool = False  #: Whether it stays when old recordings are removed.


@dataclass(frozen=True)
class Recording(Message):
    """A recording that was started or ended."""

    recording: bool = False  #: Whether it is in progress.
    name: str = ""  #: Name; empty if there was none yet.
    records: int = 0  #: Number of recorded cycles.
    lost: int = 0  #: Number of cycles that were overwritten before the disk took them.
    why: str = ""  #: Why it ended by itself; empty if it did not.
    disk_full: bool = False  #: Whether it ended by itself because the disk was full.
    files: int = 1  #: Number of its files; the names of all but the first one end in their number.
    armed: bool = False  #: Whether it waits for its edge, and has no file yet.


@dataclass(frozen=True)
class RunningRecording(Recording):
    """The recording in progress."""

    file: str = ""  #: Name of the file that is being written.


@dataclass(frozen=True)
class KeptRecording(Message):
    """A recording that was marked, or whose mark was removed."""

    name: str  #: Name.
    kept: bool  #: Whether it is marked as kept.


@dataclass(frozen=True, kw_only=True)
class Recordings(Message):
    """All recordings."""

    running: RunningRecording | None  #: The recording in progress, None if there is none.
    recordings: tuple[RecordingFile, ...]  #: The files of finished recordings.
    folder: str = ""  #: Their folder on the machine of the daemon.


@dataclass(frozen=True)
class AuditLine:
    """One request and its answer."""

    when: str  #: Time, ISO 8601 with the offset from UTC.
    uid: int  #: Number of the user.
    user: str  #: Name of the user; empty if it has none.
    client: str  #: Name that the client gives itself.
    what: str  #: The request, as in "goto x 12.5 µm".
    accepted: bool  #: Whether it was accepted.
    why: str = ""  #: Why not; empty if it was accepted.


@dataclass(frozen=True, kw_only=True)
class Audit(Message):
    """Who requested what."""

    audit: tuple[AuditLine, ...]  #: Newest first.
