"""`piezod` in a process of its own that starts at once: everything has been imported before.

To import is most of what a short-lived process does. A server does it once for all processes of a
test worker, and forks; otherwise they are what the command line starts. A daemon forks its loop and
its rescuer in turn.
"""

import multiprocessing
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from io import TextIOWrapper
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

from piezod.cli import main
from piezod.daemon.supervisor import processes
from piezod.daemon.supervisor.rescuer import MODULE as RESCUER

PIEZOD: Final = "piezod.cli.main"
SCRIPT: Final = "-c"
"""In place of a module: the first argument is the text of a script."""
STARTS_RESCUER: Final = "STARTS_RESCUER"
"""A daemon with this environment variable starts its rescuer as a program, not as a fork."""
_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["tests.preloaded"])


class Forked:
    """A process, as `subprocess.Popen` is one.

    Args:
        arguments: Of `piezod`, or of another module.
        streams: What it has for standard input, output and error; they stay open here.
        environ: Its environment; this process's if not given.
        folder: Its current folder; this process's if not given.
        module: What it runs.

    Attributes:
        pid: Its number.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        streams: tuple[int, int, int],
        environ: Mapping[str, str] | None = None,
        folder: Path | None = None,
        module: str = PIEZOD,
    ) -> None:
        theirs = [Connection(os.dup(each)) for each in streams]
        command = (module, *arguments)
        what = command, str(folder or Path.cwd()), dict(environ or os.environ), theirs
        self._process = _SERVER.Process(target=_run, args=what, daemon=True)
        self._process.start()
        for each in theirs:
            each.close()
        assert self._process.pid is not None
        self.pid = self._process.pid

    def poll(self) -> int | None:
        """Return its exit code, None while it lives."""
        return self._process.exitcode

    def wait(self, within_s: float | None = None) -> int:
        """Wait for its end; return its exit code."""
        self._process.join(within_s)
        code = self._process.exitcode
        if code is None:
            raise subprocess.TimeoutExpired("piezod", within_s or 0.0)
        return code

    def send_signal(self, number: int) -> None:
        """Send it a signal, if it lives."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Tell it to end."""
        self.send_signal(signal.SIGTERM)

    def interrupt(self) -> None:
        """Send it Ctrl-C."""
        self.send_signal(signal.SIGINT)

    def kill(self) -> None:
        """End it."""
        self.send_signal(signal.SIGKILL)


class Piped(Forked):
    """One that is talked to."""

    def __init__(self, arguments: Sequence[str], module: str = PIEZOD) -> None:
        read_fd, stdin_fd = os.pipe()
        stdout_fd, write_fd = os.pipe()
        super().__init__(arguments, (read_fd, write_fd, 2), module=module)
        os.close(read_fd)
        os.close(write_fd)
        self.stdin = os.fdopen(stdin_fd, "w", encoding="utf-8")
        self.stdout = os.fdopen(stdout_fd, encoding="utf-8")


class ForkedGuardian(Piped):
    """The guardian of a command in this process."""

    def __init__(self, command: Sequence[str], **_: Any) -> None:
        super().__init__((), module=command[2])

    def communicate(self) -> None:
        """Wait for its end."""
        self.stdin.close()
        self.wait()
        self.stdout.close()


def run(
    arguments: Sequence[str],
    environ: Mapping[str, str] | None = None,
    folder: Path | None = None,
    module: str = PIEZOD,
) -> "subprocess.CompletedProcess[str]":
    """Run a process to its end; arguments as for `Forked`."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        with Path(os.devnull).open("rb") as nothing:
            streams = (nothing.fileno(), out.fileno(), err.fileno())
            code = Forked(arguments, streams, environ, folder, module).wait()
        out.seek(0)
        err.seek(0)
        return subprocess.CompletedProcess(arguments, code, out.read(), err.read())


@contextmanager
def forked(*arguments: str) -> Iterator[Piped]:
    """Run `piezod` with these arguments while the block runs; it has ended in order afterwards."""
    process = Piped(arguments)
    with process.stdin, process.stdout:
        try:
            yield process
        finally:
            process.terminate()
            code = process.wait()
    assert code == 0


def _run(
    command: Sequence[str], folder: str, environ: Mapping[str, str], streams: Sequence[Connection]
) -> None:
    """Run a module, in the new process."""
    for number, stream in enumerate(streams):
        os.dup2(stream.fileno(), number)
        stream.close()
    os.chdir(folder)
    vars(processes)["subprocess"] = SimpleNamespace(**{**vars(subprocess), "Popen": _popen})
    _run_module(command, environ)


def _run_module(command: Sequence[str], environ: Mapping[str, str]) -> None:
    """Run a module as `python -m` does, or a script as `python -c`."""
    sys.stdin, sys.stdout, sys.stderr = (
        TextIOWrapper(os.fdopen(number, mode, closefd=False), encoding="utf-8")
        for number, mode in enumerate(("rb", "wb", "wb"))
    )
    os.environ.clear()
    os.environ.update(environ)
    module, *_ = sys.argv = list(command)
    if module == PIEZOD:
        main.run()
    elif module == SCRIPT:
        exec(sys.argv.pop(1), {"__name__": "__main__"})  # noqa: S102 - it is written in a test
    else:
        sys.modules.pop(module, None)  # it may be imported, but runs anew
        runpy.run_module(module, run_name="__main__", alter_sys=True)


def _popen(
    command: Sequence[str], env: Mapping[str, str], **options: Any
) -> "subprocess.Popen[bytes]":
    """Start `python -m MODULE` like `subprocess.Popen`, as a fork of this process."""
    if command[2] == RESCUER and STARTS_RESCUER in env:
        return subprocess.Popen(command, env=env, **options)
    be_it = partial(_be, command[2:], env)
    # Neither a loop nor a rescuer needs a lock that a thread of this process may hold.
    return subprocess.Popen(command, preexec_fn=be_it, **options)  # noqa: PLW1509 - see above


def _be(command: Sequence[str], environ: Mapping[str, str]) -> None:
    """Run a module in a fork of a daemon, and end."""
    os.closerange(3, os.sysconf("SC_OPEN_MAX"))
    signal.set_wakeup_fd(-1)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_IGN)  # as Python has it
    signal.signal(signal.SIGINT, signal.default_int_handler)
    code = 1
    try:
        _run_module(command, environ)
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:  # noqa: BLE001 - whatever it is, a process ends with it
        traceback.print_exc()
    for thread in threading.enumerate():
        if not (thread.daemon or thread is threading.current_thread()):
            thread.join()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
