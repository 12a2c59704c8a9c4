"""The files of the systemd service: their places, and their installation.

The shipped unit runs `/usr/bin/piezod`, where a distribution's package has it; the installation
replaces that by the present command.
"""

import errno
import grp
import os
import subprocess
from fnmatch import fnmatch
from pathlib import Path
from typing import Final

from piezod.records.atomic import replacing
from piezod.service_view import why_hidden

TARGETS: Final = {
    "piezod@.service": Path("usr/lib/systemd/system/piezod@.service"),
    "piezod-web.service": Path("usr/lib/systemd/system/piezod-web.service"),
    "piezod-ioc.service": Path("usr/lib/systemd/system/piezod-ioc.service"),
    "piezod.rules": Path("usr/lib/udev/rules.d/70-piezod.rules"),
    "piezod.sysusers": Path("usr/lib/sysusers.d/piezod.conf"),
    "piezod.tmpfiles": Path("usr/lib/tmpfiles.d/piezod.conf"),
}
"""Path of each file, below the root."""
PACKAGED: Final = "/usr/bin/piezod"
SERIAL_GROUPS: Final = ("dialout", "uucp")
"""Names of the group of serial ports; the first one is in the shipped file, Arch has the second."""
ELSEWHERE: Final = (
    "install piezod elsewhere: python3 -m venv /opt/piezod, then /opt/piezod/bin/pip install the "
    "wheel of piezod"
)
"""What to do if the service cannot reach the command."""
_UNITS: Final = ("piezod@*.service", "piezod-web.service", "piezod-ioc.service")
_WANTED: Final = Path("/etc/systemd/system")
"""`systemctl list-unit-files` does not list enabled instances of a unit."""


def install(source: Path, root: Path, command: Path) -> list[Path]:
    """Write the files; those of an earlier version are replaced.

    Args:
        source: Folder of the shipped files.
        root: Folder below which they are written: /, or another one to build a package.
        command: Absolute path of the command that the unit runs.

    Returns:
        The files that were written.

    Raises:
        OSError: If one cannot be written.
        ValueError: If a unit cannot have that command, or its service could not run it.
    """
    check_command(command)
    # Read all before the first is written: a missing file must not leave half an installation.
    texts = {name: (source / name).read_text(encoding="utf-8") for name in TARGETS}
    for unit in (name for name in TARGETS if name.endswith(".service")):
        texts[unit] = texts[unit].replace(PACKAGED, str(command))
    texts["piezod.sysusers"] = texts["piezod.sysusers"].replace(SERIAL_GROUPS[0], serial_group())
    written = []
    for name, target in TARGETS.items():
        with replacing(root / target) as temporary:
            temporary.write_text(texts[name], encoding="utf-8")
            temporary.chmod(0o644)
        written.append(root / target)
    return written


def uninstall(root: Path) -> list[Path]:
    """Remove the files that exist; return them.

    Raises:
        OSError: If one cannot be removed.
    """
    found = [root / target for target in TARGETS.values() if (root / target).exists()]
    for path in found:
        path.unlink()
    return found


def serial_group() -> str:
    """Return the group of the serial ports of this machine."""
    present = {group.gr_name for group in grp.getgrall()}
    return next((name for name in SERIAL_GROUPS if name in present), SERIAL_GROUPS[0])


def units_in_use(wanted: Path = _WANTED) -> list[str]:
    """Return the units of stages, page and IOC that run on this machine or start with it.

    Args:
        wanted: Folder of the links of enabled units.
    """
    states = "--state=activating,active,reloading,deactivating"
    command = ("systemctl", "list-units", "--plain", "--no-legend", states, *_UNITS)
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - constant
    except FileNotFoundError:  # a machine without systemd
        return []
    running = [line.split()[0] for line in done.stdout.splitlines() if line.strip()]
    links = sorted(link.name for link in wanted.glob("*.wants/piezod*"))
    enabled = [name for name in links if any(fnmatch(name, unit) for unit in _UNITS)]
    return list(dict.fromkeys(running + enabled))


def check_root(root: Path) -> None:
    """Check that this user may write the files.

    Raises:
        PermissionError: If the files are for this machine and this user is not root.
    """
    if root == Path("/") and os.geteuid() != 0:
        what = "only root may write here; run it with sudo, or with --root DIR to build a package"
        raise PermissionError(errno.EACCES, what, str(root / TARGETS["piezod@.service"].parent))


def check_command(command: Path) -> None:
    """Check that a unit can have a command, and that its service would see it.

    Raises:
        ValueError: If not; the text has the remedy.
    """
    # Any other character would need quotes in a unit.
    text = str(command)
    if not command.is_absolute() or any(not (c.isalnum() or c in "/._-+@") for c in text):
        raise ValueError(f"must be an absolute path of letters, digits and /._-+@ (got {text!r})")
    if why := why_hidden(command):
        raise ValueError(f"{text}: {why}; {ELSEWHERE}")
