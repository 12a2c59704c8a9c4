"""The paths of a stage's files; imports nothing that takes long.

systemd sets `$RUNTIME_DIRECTORY` and `$STATE_DIRECTORY`; without them the user's own folders are
used.
"""

import errno
import os
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from piezod.errors import ConfigError, Problem
from piezod.home import user_folder
from piezod.own_folder import make_folder

# The address of a unix socket has 108 bytes, the last of which is zero.
LONGEST_SOCKET_PATH: Final = 107
IDENTITIES: Final = "identities.json"
PLAYED: Final = "play.json"
SCANNED: Final = "scan.json"
SCANNED_ROWS: Final = "scan.rows"


class StagePaths(NamedTuple):
    """The files of one stage."""

    name: str  #: Name of the stage: that of its configuration file, without the suffix.
    runtime: Path  #: Folder that lasts until the machine is shut down.
    state: Path  #: Folder that lasts.

    @property
    def lock(self) -> Path:
        """The file that the supervisor locks until its end, with its process id.

        It is where the state is: a daemon with another runtime folder has the same stage.
        """
        return self.state / "lock"

    @property
    def loop_lock(self) -> Path:
        """The file that the present user of the devices locks: a loop process or `piezod safe`."""
        return self.state / "loop.lock"

    @property
    def api_socket(self) -> Path:
        """The unix socket of the HTTP interface."""
        return self.runtime / "api.sock"

    @property
    def spare_socket(self) -> Path:
        """A second socket of it, beside the lock, if the runtime folder is removed."""
        return self.state / self.api_socket.name

    @property
    def loop_map(self) -> Path:
        """The memory shared by supervisor and loop process."""
        return self.runtime / "loop.map"

    @property
    def output_map(self) -> Path:
        """The last written voltage of each axis, for `piezod safe`."""
        return self.runtime / "output.map"

    @property
    def identities(self) -> Path:
        """The identity of each device when the loop opened it, for `piezod safe`."""
        return self.runtime / IDENTITIES

    @property
    def played(self) -> Path:
        """The record of the last play."""
        return self.runtime / PLAYED

    @property
    def scanned(self) -> tuple[Path, Path]:
        """The state of the last scan, and its samples."""
        return self.runtime / SCANNED, self.runtime / SCANNED_ROWS

    @property
    def running(self) -> Path:
        """The mark of a running stage."""
        return self.state / "running"

    @property
    def parameters(self) -> Path:
        """Folder of the parameter store."""
        return self.state / "parameters"

    @property
    def recordings(self) -> Path:
        """Folder of the recordings."""
        return self.state / "recordings"

    @property
    def flights(self) -> Path:
        """Folder of the flight records."""
        return self.state / "flights"

    @property
    def audit(self) -> Path:
        """The audit log."""
        return self.state / "audit.jsonl"

    def make_folders(self) -> None:
        """Make the folders, for this user only; existing ones keep their mode.

        Raises:
            OSError: If one cannot be made or belongs to another user, or if the path of the socket
                is too long.
        """
        for folder in (self.runtime, self.state):
            make_private_folder(folder)
        if len(os.fsencode(self.api_socket)) > LONGEST_SOCKET_PATH:
            what = f"too long for a socket, allowed: {LONGEST_SOCKET_PATH} bytes; "
            remedy = "set XDG_RUNTIME_DIR to a shorter path"
            raise OSError(errno.ENAMETOOLONG, what + remedy, str(self.api_socket))


def make_private_folder(folder: Path) -> None:
    """Make a folder for this user only; an existing one keeps its mode.

    Raises:
        OSError: If it cannot be made or belongs to another user.
    """
    make_folder(folder)
    # The parent too: a user who may write there could replace the folder.
    _check_owner(folder.parent)
    _check_owner(folder)


def stage_paths(config: Path, environ: Mapping[str, str] = os.environ) -> StagePaths:
    """Return the paths of the files of a stage; make none of them.

    Args:
        config: The configuration file.
        environ: The environment variables.

    Raises:
        ConfigError: If a folder cannot have the file's name, or a path is no UTF-8 text.
    """
    name = config.stem
    if not name or name.startswith("."):
        what = f"its name is that of the stage and must not begin with a dot (got {name!r})"
        raise ConfigError(Problem(str(config), 0, 0, "", what))
    paths = StagePaths(name, _runtime(name, environ), _state(name, environ))
    for path in (config.absolute(), paths.runtime, paths.state):
        # Bytes that are no text, which Python holds as half of a surrogate pair.
        if any("\ud800" <= character <= "\udfff" for character in str(path)):
            what = f"the path {path} is no UTF-8 text, and cannot be stored in a file: rename it"
            raise ConfigError(Problem(str(config), 0, 0, "", what))
    return paths


def _runtime(name: str, environ: Mapping[str, str]) -> Path:
    if given := _given("RUNTIME_DIRECTORY", environ):
        return given
    if users := _given("XDG_RUNTIME_DIR", environ):
        return users / "piezod" / name
    return Path(tempfile.gettempdir()) / f"piezod-{os.getuid()}" / name


def _state(name: str, environ: Mapping[str, str]) -> Path:
    if given := _given("STATE_DIRECTORY", environ):
        return given
    return user_folder("XDG_STATE_HOME", environ) / "piezod" / name


def _given(variable: str, environ: Mapping[str, str]) -> Path | None:
    """Return the folder in a variable, the first of several; None if it is not absolute."""
    folder = Path(environ.get(variable, "").split(":")[0])
    return folder if folder.is_absolute() else None


def _check_owner(folder: Path) -> None:
    """Refuse a folder that other users own or may write to: they could put a socket there."""
    found = folder.lstat()
    # With the sticky bit, as in /tmp, others cannot replace what is not theirs.
    shared = found.st_mode & stat.S_IWOTH and not found.st_mode & stat.S_ISVTX
    if not stat.S_ISDIR(found.st_mode) or found.st_uid not in (os.getuid(), 0) or shared:
        own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
        remedy = f"`chmod o-w {folder}`" if own else "move it away, or ask its owner"
        what = f"must be a folder of this user that no other user may write to: {remedy}"
        raise PermissionError(errno.EACCES, what, str(folder))
