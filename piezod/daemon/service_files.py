"""The files of the systemd service: where they go, and how they get there.

The unit runs `/usr/bin/piezod`, which is where a distribution's package has it; the command in use
is put in its place.
"""

import errno
import os
import stat
from pathlib import Path
from typing import Final

from piezod.records.atomic import replacing

TARGETS: Final = {
    "piezod@.service": Path("usr/lib/systemd/system/piezod@.service"),
    "piezod.rules": Path("usr/lib/udev/rules.d/70-piezod.rules"),
    "piezod.sysusers": Path("usr/lib/sysusers.d/piezod.conf"),
    "piezod.tmpfiles": Path("usr/lib/tmpfiles.d/piezod.conf"),
}
"""Where each file goes, below the root."""
PACKAGED: Final = "/usr/bin/piezod"
_HIDDEN: Final = (Path("/home"), Path("/root"), Path("/run/user"))
"""What ProtectHome= of the unit hides."""


def install(source: Path, root: Path, command: Path) -> list[Path]:
    """Write the files; those of an earlier version are replaced.

    Args:
        source: The folder that has them as they are shipped.
        root: Below which they go; / but for packaging.
        command: What the unit is to run, an absolute path.

    Returns:
        What was written.

    Raises:
        OSError: If one cannot be written.
        ValueError: If a unit cannot have that command, or its service could not run it.
    """
    _check_command(command)
    texts = {name: (source / name).read_text(encoding="utf-8") for name in TARGETS}
    texts["piezod@.service"] = texts["piezod@.service"].replace(PACKAGED, str(command))
    written = []
    for name, target in TARGETS.items():
        with replacing(root / target) as temporary:
            temporary.write_text(texts[name], encoding="utf-8")
            temporary.chmod(0o644)
        written.append(root / target)
    return written


def uninstall(root: Path) -> list[Path]:
    """Remove the files, as far as they are there; return those that were.

    Raises:
        OSError: If one cannot be removed.
    """
    found = [root / target for target in TARGETS.values() if (root / target).exists()]
    for path in found:
        path.unlink()
    return found


def check_root(root: Path) -> None:
    """Refuse to begin without the rights for it.

    Raises:
        PermissionError: If the files are for this machine and this user is not root.
    """
    if root == Path("/") and os.geteuid() != 0:
        what = "only root may write here; run it by sudo, or for packaging with --root DIR"
        raise PermissionError(errno.EACCES, what, str(root / TARGETS["piezod@.service"].parent))


def why_unreachable(path: Path) -> str:
    """Tell why the user of the service could not run a file of this machine; empty if it could."""
    real = path.resolve()
    for folder in real.parents:
        if folder in _HIDDEN:
            return f"the service sees nothing below {folder}"
        if folder.exists() and not folder.stat().st_mode & stat.S_IXOTH:
            return f"{folder} is closed to other users"
    return ""


def _check_command(command: Path) -> None:
    text = str(command)
    if not command.is_absolute() or any(not (c.isalnum() or c in "/._-+@") for c in text):
        raise ValueError(f"must be an absolute path of letters, digits and /._-+@ (got {text!r})")
