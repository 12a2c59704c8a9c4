"""What a service of systemd sees of the machine's files, and who else may change a file.

The units of piezod have ProtectHome= and PrivateTmp=: folders of users and temporary files are not
there for them. Every check of a path for a service is made here.
"""

import grp
import os
import pwd
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

HIDDEN: Final = {
    Path("/home"): "ProtectHome",
    Path("/root"): "ProtectHome",
    Path("/run/user"): "ProtectHome",
    Path("/tmp"): "PrivateTmp",  # noqa: S108 - it is looked at, nothing is put there
    Path("/var/tmp"): "PrivateTmp",  # noqa: S108 - likewise
}
"""Folders that the units hide, and the setting that does."""
SERVICES: Final = Path("/etc/piezod")
"""Folder of the configurations that services run."""
_MOST_LINKS: Final = 40


def why_hidden(path: Path) -> str:
    """Return why a service would not find a file, or ""; a link on the way counts, too."""
    for step in _way(path):
        if step in HIDDEN:
            return f"the service sees nothing below {step} ({HIDDEN[step]}=yes in its unit)"
    return ""


def why_unreachable(path: Path) -> str:
    """Return why the user of a service could not use a file of this machine, or ""."""
    if why := why_hidden(path):
        return why
    for step in _way(path):  # each folder needs the x permission for others
        if step.is_dir() and not step.stat().st_mode & stat.S_IXOTH:
            return f"{step} is closed to other users"
    return ""


def service_hint(path: Path, environ: Mapping[str, str] = os.environ) -> str:
    """Return what to add to an error about a file, if a service cannot see it; or ""."""
    if "RUNTIME_DIRECTORY" not in environ or not (why := why_hidden(path.absolute())):
        return ""
    return f"; {why}: put the file below {SERVICES}"


def who_may_change(path: Path) -> tuple[str, ...]:
    """Return a sentence for each file or folder on the way that other users may change.

    Args:
        path: A file that decides what a stage does.
    """
    return tuple(filter(None, map(_open_to_others, _way(path.absolute()))))


def _open_to_others(step: Path) -> str:
    try:
        found = step.lstat()
    except OSError:
        return ""
    if stat.S_ISLNK(found.st_mode):
        return ""  # its mode has no meaning; folder and target are steps, too
    # With the sticky bit, as in /tmp, others cannot replace what is not theirs.
    sticky = stat.S_ISDIR(found.st_mode) and found.st_mode & stat.S_ISVTX
    shown = f"{step} (mode {stat.S_IMODE(found.st_mode):04o})"
    if found.st_mode & stat.S_IWOTH and not sticky:
        return f"every user of this machine may change {shown}: `chmod o-w {step}`"
    members = _others_in_group(found.st_gid, found.st_uid)
    if found.st_mode & stat.S_IWGRP and not sticky and members:
        return f"{members} may change {shown}: `chmod g-w {step}`"
    return ""


def _others_in_group(group: int, owner: int) -> str:
    try:
        found = grp.getgrgid(group)
        own = pwd.getpwuid(owner).pw_name
    except KeyError:
        return ""
    others = [name for name in found.gr_mem if name not in (own, "root")]
    return f"{', '.join(others)} (group {found.gr_name})" if others else ""


def _way(path: Path) -> Iterator[Path]:
    """Yield every folder and link that leads to a file, and the file, as the kernel goes."""
    at, links = Path("/"), 0
    rest = list(reversed(path.parts[1:]))
    yield at
    while rest:
        part = rest.pop()
        at = at.parent if part == ".." else at / part
        yield at
        try:
            target = at.readlink()
        except OSError:  # no link, or nothing at all
            continue
        links += 1
        if links > _MOST_LINKS:
            return
        at = Path("/") if target.is_absolute() else at.parent
        rest += reversed([each for each in target.parts if each != "/"])
