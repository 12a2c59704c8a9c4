"""File descriptors of the supervisor."""

import asyncio
import errno
import io
import resource

import pytest

from piezod.daemon.descriptors import LEAST, WANTED, raise_limit
from piezod.daemon.supervisor.quiet_loop import QuietLoop
from piezod.errors import PiezodError

NO_LIMIT = resource.RLIM_INFINITY


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ((1024, 524288), (WANTED, 524288)),
        ((1024, NO_LIMIT), (WANTED, NO_LIMIT)),
        ((64, LEAST), (LEAST, LEAST)),
        ((8192, 8192), (8192, 8192)),
        ((NO_LIMIT, NO_LIMIT), (NO_LIMIT, NO_LIMIT)),
    ],
)
def test_limit_is_raised_as_far_as_allowed(
    monkeypatch: pytest.MonkeyPatch, before: tuple[int, int], after: tuple[int, int]
) -> None:
    """A higher limit stays."""
    limits = [before]
    monkeypatch.setattr(resource, "getrlimit", lambda _: limits[-1])
    monkeypatch.setattr(resource, "setrlimit", lambda _, new: limits.append(new))

    raise_limit()

    assert limits[-1] == after


def test_too_low_a_limit_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error has the limit, the least one and the remedy."""
    monkeypatch.setattr(resource, "getrlimit", lambda _: (20, 20))
    monkeypatch.setattr(resource, "setrlimit", lambda *_: None)

    with pytest.raises(PiezodError, match=r"20 files, at least 128 .*`ulimit -n 1024`"):
        raise_limit()


def test_lack_of_descriptors_is_logged_once(log: io.StringIO) -> None:
    """A thousand connections that cannot be accepted leave one line."""
    loop, handler = asyncio.new_event_loop(), QuietLoop()
    error = OSError(errno.EMFILE, "Too many open files")
    for _ in range(1000):
        handler(loop, {"message": "socket.accept() out of system resource", "exception": error})
    loop.close()

    assert log.getvalue().count("\n") == 1
    assert "no connection accepted" in log.getvalue()
    assert "Too many open files" in log.getvalue()


def test_other_errors_of_the_event_loop_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    """They have a traceback, as without the handler."""
    loop, handler = asyncio.new_event_loop(), QuietLoop()
    handler(loop, {"message": "a task failed", "exception": ValueError("no")})
    loop.close()

    assert "a task failed" in caplog.text
