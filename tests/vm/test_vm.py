"""The side of the host: what it needs, what it downloads, what it prints of the guest's results."""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.supply.lock import pins
from tests.vm import wheels
from tests.vm.report import serve, verdict

LOCK = """\
# made by make lock
bitstruct==8.24.0 \\
    --hash=sha256:aaaa \\
    --hash=sha256:bbbb
    # via cantools
coverage==7.17.3 \\
    --hash=sha256:dddd
networkx==3.6.1 ; python_full_version < '3.12' \\
    --hash=sha256:cccc
"""


def no_answer(_text: str) -> None:
    """Take an answer for a guest that asked for nothing."""
    raise AssertionError


def line(**document: object) -> str:
    """Return a line of the guest."""
    return json.dumps(document) + "\n"


def check(name: str, reason: str = "") -> str:
    """Return the line of the guest about a check."""
    return line(name=name, reason=reason, detail="seen", duration_s=1.5)


def test_results_are_printed_one_by_one(capsys: pytest.CaptureFixture[str]) -> None:
    """Each check has a line with its verdict and its reason, and a failure makes the exit code."""
    results = serve([check("starts"), check("stops", "hangs"), line(end=True)], no_answer, {})

    printed = capsys.readouterr().out.splitlines()
    assert printed == ["ok        1.5 s  starts: seen", "failed    1.5 s  stops: hangs"]
    assert verdict(results) == ("1 ok, 1 failed", 1)
    assert (verdict(results[:1]), verdict([])[1]) == (("1 ok, 0 failed", 0), 1)


def test_guest_that_ends_early_has_failed() -> None:
    """A guest that ends before its last check makes the run fail."""
    results = serve([check("starts")], no_answer, {})

    assert verdict(results) == ("1 ok, 1 failed", 1)
    assert results[-1].reason == "it ended before its last check"


def test_guest_that_hangs_has_failed() -> None:
    """So does a guest that sends nothing any more."""

    def lines() -> Iterator[str]:
        yield check("starts")
        raise TimeoutError

    assert serve(lines(), no_answer, {})[-1].reason == "it hangs"


def test_pins_keep_their_markers() -> None:
    """The constraints have versions and markers of a lock file, and no hashes."""
    assert pins(LOCK) == [
        "bitstruct==8.24.0",
        "coverage==7.17.3",
        "networkx==3.6.1 ; python_full_version < '3.12'",
    ]


def test_wheel_that_no_lock_file_names_is_refused(tmp_path: Path) -> None:
    """A downloaded file must have one of the hashes of the lock files."""
    (tmp_path / "a.whl").write_bytes(b"a")
    wheels.check_hashes(tmp_path, f"--hash=sha256:{hashlib.sha256(b'a').hexdigest()}")

    with pytest.raises(ValueError, match=r"a\.whl: its SHA-256 \w+ is in no lock file"):
        wheels.check_hashes(tmp_path, LOCK)
