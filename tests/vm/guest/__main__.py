"""Makes all checks in the guest, one by one, and reports each to the host."""

import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from tests.vm.guest import install
from tests.vm.guest.host import Host

JOURNAL: Final = "journalctl --boot --no-pager --output=short-monotonic > /mnt/host/journal.txt"

ONLY: Final = Path("/mnt/host/only.txt")
"""File with the first words of the checks to make; empty for all."""
ALWAYS: Final = "install-service"


def main() -> None:
    """Make the checks."""
    host = Host()
    if make(host, "the wheel is installed offline", install.wheel_is_installed):
        from tests.vm.guest.checks import checks  # noqa: PLC0415 - it imports what is in the wheel

        wanted = tuple(ONLY.read_text("utf-8").split()) or ("",)
        for name, check in checks(host):
            if name.startswith((*wanted, ALWAYS)):
                make(host, name, check)
    subprocess.run(["/bin/sh", "-c", JOURNAL], check=False)
    host.end()


def make(host: Host, name: str, check: Callable[[], str]) -> bool:
    """Make a check, report its result, and return whether it passed."""
    begin_s = time.monotonic()
    reason, detail = "", ""
    try:
        detail = check()
    except Exception as error:  # noqa: BLE001 - whatever happens is the result of this check
        reason = f"{type(error).__name__}: {error}"
    host.report(name, reason, detail, time.monotonic() - begin_s)
    return not reason


if __name__ == "__main__":
    main()
