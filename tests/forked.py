"""`piezod` in a process of its own that starts at once: everything has been imported before.

To import is most of what a short-lived process does. A server does it once for all processes of a
test worker, and forks; otherwise they are what the command line starts.
"""

import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from multiprocessing.connection import Connection
from pathlib import Path

from piezod.cli import main

_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["tests.preloaded"])


class Forked:
    """A process.

    Attributes:
        pid: Its number.
        stdin: What is written here, it reads from standard input.
        stdout: What it prints.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        read_fd, stdin_fd = os.pipe()
        stdout_fd, write_fd = os.pipe()
        theirs = (
            Connection(read_fd, writable=False),
            Connection(write_fd, readable=False),
            Connection(os.dup(2), readable=False),
        )
        what = tuple(arguments), str(Path.cwd()), dict(os.environ), theirs
        self._process = _SERVER.Process(target=_run, args=what)
        self._process.start()
        for each in theirs:
            each.close()
        assert self._process.pid is not None
        self.pid = self._process.pid
        self.stdin = os.fdopen(stdin_fd, "w", encoding="utf-8")
        self.stdout = os.fdopen(stdout_fd, encoding="utf-8")

    def end(self) -> int | None:
        """Tell it to end, and wait; return its exit code."""
        if self._process.is_alive():
            os.kill(self.pid, signal.SIGTERM)
        self._process.join()
        code = self._process.exitcode
        self._process.close()
        self.stdin.close()
        self.stdout.close()
        return code


@contextmanager
def forked(*arguments: str) -> Iterator[Forked]:
    """Run `piezod` with these arguments while the block runs; it has ended in order afterwards."""
    process = Forked(arguments)
    try:
        yield process
    finally:
        code = process.end()
    assert code == 0


def _run(
    arguments: Sequence[str], folder: str, environ: Mapping[str, str], streams: Sequence[Connection]
) -> None:
    """Be `piezod`, in the new process."""
    for number, stream in enumerate(streams):
        os.dup2(stream.fileno(), number)
        stream.close()
    sys.stdin, sys.stdout, sys.stderr = (
        TextIOWrapper(os.fdopen(number, mode, closefd=False), encoding="utf-8")
        for number, mode in enumerate(("rb", "wb", "wb"))
    )
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environ)
    sys.argv = ["piezod", *arguments]
    main.run()
