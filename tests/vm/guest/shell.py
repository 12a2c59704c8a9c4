"""Commands of the guest, and waits for them."""

import subprocess
import time
from collections.abc import Callable
from typing import Final, TypeVar

PIEZOD: Final = "/opt/piezod/bin/piezod"


class CheckError(Exception):
    """Raised if a fact does not hold; the text is the reason."""


CheckT = TypeVar("CheckT", bound=Callable[[], str])


def confirms(_driver: str, _profile: str, **_facts: str) -> Callable[[CheckT], CheckT]:
    """Mark a check as evidence, as pytest's mark of this name does: `tests.evidence` reads it."""
    return lambda check: check


def need(holds: object, reason: str) -> None:
    """Raise `CheckError` with a reason unless something holds."""
    if not holds:
        raise CheckError(reason)


def attempt(command: str, timeout_s: float = 600.0) -> "subprocess.CompletedProcess[str]":
    """Run a shell command as root, whether it fails or not."""
    return subprocess.run(
        ["/bin/sh", "-c", command],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout_s,
    )


def run(command: str, timeout_s: float = 600.0) -> str:
    """Run a shell command as root; return its output."""
    ended = attempt(command, timeout_s)
    need(not ended.returncode, f"`{command}` ended with {ended.returncode}: {ended.stderr.strip()}")
    return ended.stdout.strip()


def wait_until(condition: Callable[[], object], what: str, within_s: float = 120.0) -> None:
    """Wait until a condition holds.

    Raises:
        CheckError: If the time is over; the reason tells what was waited for.
    """
    begin_s = time.monotonic()
    while not condition():
        waited_s = time.monotonic() - begin_s
        need(waited_s < within_s, f"not within {within_s:g} s: {what}")
        # On an emulated processor each look slows down what is waited for.
        time.sleep(max(0.2, waited_s / 20))


def shows(unit: str, name: str) -> str:
    """Return a property of a unit."""
    return run(f"systemctl show --value --property={name} {unit}")
