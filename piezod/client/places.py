"""The sockets of the daemons of this machine, and the choice of one."""

import errno
import os
import socket
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from glob import escape
from pathlib import Path
from typing import Final

from piezod.errors import (
    AmbiguousStageError,
    ClientError,
    NotAllowedError,
    NotRunningError,
    UnreachableError,
)
from piezod.home import user_folder

SOCKET_NAME: Final = "api.sock"
_SYSTEM: Final = Path("/run/piezod")
_SYSTEM_STATE: Final = Path("/var/lib/piezod")
_LOCKS: Final = Path("/proc/locks")
_GROUPS: Final = Path("/etc/piezod/groups.yaml")
_START_IT: Final = "start it with `piezod run CONFIG`"


def find_socket(
    stage: str | None = None,
    environ: Mapping[str, str] = os.environ,
    system: Path = _SYSTEM,
) -> Path:
    """Return the socket of the chosen stage.

    If no stage is named, `PIEZOD_SOCKET` gives the path of the socket. Otherwise the name is
    `stage` or `PIEZOD_STAGE`; its socket is in the runtime folder of services or of this user.
    Without a name the only running stage is chosen.

    Args:
        stage: Name of the stage: the stem of the file name of its configuration.
        environ: Environment variables.
        system: Folder of the services.

    Raises:
        NotRunningError: If no daemon listens, or none of that name.
        UnreachableError: If one runs without its sockets.
        AmbiguousStageError: If several daemons listen and no name is given.
        ClientError: If the name is an address.
    """
    if stage is None and (path := environ.get("PIEZOD_SOCKET")):
        return Path(path)
    name = stage or environ.get("PIEZOD_STAGE")
    if name is not None and is_address(name):
        what = f"{name}: a stage of this machine is needed"
        raise ClientError(what, "run this command on the machine of the stage")
    running = running_stages(environ, system)
    if name is None and len(running) == 1:
        return next(iter(running.values()))
    if name is None and running:
        what = f"several stages are running: {', '.join(running)}"
        raise AmbiguousStageError(what, "name one with --stage, or in PIEZOD_STAGE")
    if name in running:
        return running[name]
    _refuse_unreachable(name, environ)
    if name is None:
        raise NotRunningError("no daemon is running", _remedy(None, environ))
    others = f", running: {', '.join(running)}" if running else ""
    what = f"no daemon is running for stage {name!r}{others}"
    raise NotRunningError(what, _remedy(name, environ))


def is_address(stage: str) -> bool:
    """Return whether a stage is named by its address on another machine."""
    return stage.startswith(("http://", "https://"))


def running_stages(
    environ: Mapping[str, str] = os.environ, system: Path = _SYSTEM
) -> dict[str, Path]:
    """Return the sockets on which daemons listen, by the sorted names of their stages."""
    found: dict[str, Path] = {}
    for folder in _folders(environ, system):
        for path in sorted(folder.glob(f"*/{SOCKET_NAME}")):
            if path.parent.name not in found and _is_alive(path):
                found[path.parent.name] = path
    return dict(sorted(found.items()))


def _folders(environ: Mapping[str, str], system: Path) -> Iterator[Path]:
    yield system
    if runtime := environ.get("XDG_RUNTIME_DIR"):
        yield Path(runtime) / "piezod"
    own = Path(tempfile.gettempdir()) / f"piezod-{os.getuid()}"
    if _is_ours(own):
        yield own
    # The second socket of each stage, if somebody has removed the runtime folder.
    yield from _state_folders(environ)


def _state_folders(environ: Mapping[str, str]) -> Iterator[Path]:
    yield _SYSTEM_STATE
    with suppress(RuntimeError):  # this user has no home
        yield Path(environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "piezod"


def _remedy(name: str | None, environ: Mapping[str, str]) -> str:
    """Return what to do without the daemon of this name, or of any name.

    One that was killed may have left a voltage, and nothing that needs a daemon ramps it down.
    """
    marks = _files_of(name, "running", environ)
    unclean = ", ".join(repr(mark.parent.name) for mark in marks)
    if not unclean:
        return _START_IT
    return (
        f"the last run of {unclean} did not end in order, so that a voltage may stay: `piezod safe "
        "CONFIG` ramps it down, as `piezod run CONFIG` does when it starts"
    )


def _files_of(name: str | None, file: str, environ: Mapping[str, str]) -> Iterator[Path]:
    """Yield the files of this name of a stage, or of all stages, among those that last."""
    for folder in _state_folders(environ):
        yield from sorted(folder.glob(f"{escape(name) if name else '*'}/{file}"))


def _refuse_unreachable(name: str | None, environ: Mapping[str, str]) -> None:
    """Refuse to call a stage ended whose daemon lives without its sockets.

    Raises:
        UnreachableError: If there is one of this name, or of any name.
    """
    for lock in _files_of(name, "lock", environ):
        if pid := _holder(lock):
            stage = lock.parent.name
            what = f"stage {stage!r} runs as process {pid}, and its sockets are gone"
            remedy = f"`piezod stop` or `kill {pid}` ramps it down and ends it"
            raise UnreachableError(what, remedy, pid)


def _holder(lock: Path) -> int:
    """Return the process that holds a lock; 0 if nobody does. Does not touch the lock."""
    try:
        pid, inode = int(lock.read_text(encoding="ascii")), lock.stat().st_ino
        held = [line.split() for line in _LOCKS.read_text(encoding="ascii").splitlines()]
    except (OSError, ValueError):
        return 0
    ours = (str(pid), str(inode))
    return pid if any((line[4], line[5].rpartition(":")[2]) == ours for line in held) else 0


def _is_ours(folder: Path) -> bool:
    # Any user can make a folder in /tmp, and receive commands there that are for a stage.
    try:
        found = folder.lstat()
    except OSError:
        return False
    return (
        found.st_uid == os.getuid() and not folder.is_symlink() and not found.st_mode & stat.S_IWOTH
    )


def groups_file(environ: Mapping[str, str] = os.environ, system: Path = _GROUPS) -> Path:
    """Return the file of the groups: that of `PIEZOD_GROUPS`, of this user, or of the machine.

    Args:
        environ: Environment variables.
        system: The file of the machine.
    """
    if path := environ.get("PIEZOD_GROUPS"):
        return Path(path)
    try:
        own = user_folder("XDG_CONFIG_HOME", environ) / "piezod" / _GROUPS.name
    except FileNotFoundError:  # a user without a home
        return system
    return own if own.exists() else system


def check_socket(path: Path) -> Path:
    """Return the path of a socket on which a daemon listens.

    Raises:
        NotRunningError: If no daemon listens.
        UnreachableError: If the daemon of this stage runs without its sockets.
        NotAllowedError: If this user may not connect to it.
    """
    code = _probe(path)
    if code in (errno.EACCES, errno.EPERM):
        what = f"{path}: this user may not connect to the daemon"
        remedy = (
            "become a member of the group piezod-view, which opens the socket; to do more than "
            "look, also of piezod or piezod-eng"
        )
        raise NotAllowedError(what, remedy)
    if code not in (0, errno.EAGAIN):
        _refuse_unreachable(path.parent.name, os.environ)
        remedy = _remedy(path.parent.name, os.environ)
        raise NotRunningError(f"{path}: no daemon is running there", remedy)
    return path


def _is_alive(path: Path) -> bool:
    # The socket of a killed daemon refuses connections; a daemon that denies access is alive.
    return _probe(path) in (0, errno.EACCES, errno.EPERM, errno.EAGAIN)


def _probe(path: Path) -> int:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as probe:
        try:
            return probe.connect_ex(os.fsencode(path))
        except OSError:
            return errno.ENAMETOOLONG
