"""Processors of loops: each its own, as long as there are enough."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from piezod.daemon.loop import processor
from piezod.daemon.loop.processor import ClaimedProcessor, claim_processor, free_processors


class Claims:
    """Claims processors, and releases them at the end."""

    def __init__(self, held: ExitStack) -> None:
        self._held = held

    def __call__(self, wanted: int | None, *allowed: int) -> tuple[int, int]:
        claimed = claim_processor(wanted, allowed)
        assert claimed.mark is not None
        self._held.enter_context(claimed.mark)
        return claimed.cpu, claimed.shared_with


@pytest.fixture
def claim(monkeypatch: pytest.MonkeyPatch) -> Iterator[Claims]:
    """Return a function that claims processors nobody else of this machine knows."""
    monkeypatch.setattr(processor, "_MARK", f"test/{os.getpid()}/{{cpu}}/{{place}}")
    with ExitStack() as held:
        yield Claims(held)


def test_each_loop_gets_a_processor_of_its_own(claim: Claims) -> None:
    """The last allowed processor comes first; when all have a loop, all get a second one."""
    found = [claim(None, 0, 2, 3) for _ in range(5)]

    assert found == [(3, 0), (2, 0), (0, 0), (3, 1), (2, 1)]


def test_configured_processor_is_kept(claim: Claims) -> None:
    """A processor of the configuration is used even if it is shared; others avoid it then."""
    assert [claim(3, 2, 3), claim(3, 2, 3), claim(None, 2, 3)] == [(3, 0), (3, 1), (2, 0)]


def test_free_processors_are_found_without_claiming_them(claim: Claims) -> None:
    """The list of the kernel shows which processors have a loop."""
    claim(3, 2, 3)

    assert free_processors((2, 3, 4)) == [2, 4]
    assert free_processors((2, 3), Path("/absent")) is None


def test_processor_is_free_again_when_the_process_was_killed(claim: Claims) -> None:
    """The kernel removes the mark; no file is left behind."""
    code = (
        "import os, sys; from piezod.daemon.loop import processor; processor._MARK = sys.argv[1];"
        "kept = processor.claim_processor(None, (3,)); print(kept.shared_with, flush=True);"
        "os.kill(os.getpid(), 9)"
    )
    command = [sys.executable, "-c", code, processor._MARK]  # noqa: SLF001 - that of this test
    done = subprocess.run(command, capture_output=True, text=True, check=False)

    assert (done.stdout, done.returncode) == ("0\n", -9)
    assert claim(None, 3) == (3, 0)


def test_system_without_marks_leaves_the_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    """If marks are not allowed, the loop has the last processor and counts no others."""

    def refuse(_cpu: int, _place: int) -> None:
        raise PermissionError(13, "not allowed")

    monkeypatch.setattr(processor, "_mark", refuse)

    assert claim_processor(None, (0, 1)) == ClaimedProcessor(1, 0, None)
