"""Starts the processes of a stage."""

import os
import subprocess
import sys

from piezod.daemon.supervisor.notify import without_manager


def start(module: str, *arguments: str) -> "subprocess.Popen[bytes]":
    """Start a module of piezod as a process that the signals of this terminal do not reach.

    Its standard input and output are pipes to this process. It is no process of asyncio, which
    would kill it when this process ends with an error: a loop without its supervisor has to ramp
    down.

    Args:
        module: The module.
        arguments: Its arguments.

    Raises:
        OSError: If it cannot be started.
    """
    # A new session: Ctrl-C in a terminal reaches only the supervisor.
    return subprocess.Popen(  # noqa: S603 - our own interpreter and module
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        # Linear algebra of this size needs no threads, and they would disturb a real-time process.
        env={**without_manager(os.environ), "OPENBLAS_NUM_THREADS": "1"},
        start_new_session=True,
    )
