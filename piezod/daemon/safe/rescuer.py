"""The rescuer: `python -m piezod.daemon.safe.rescuer NAME RUNTIME STATE CONFIG`.

The supervisor starts it with each loop. It loads the configuration, the drivers and the ramp,
answers `READY`, and waits with no device open. On the line `RAMP` it brings the stage to its safe
voltage and answers with one line of JSON. The supervisor kills it at the end. If its input ends
before, the supervisor has died: then it ramps by itself, unless the run has ended in order, and
prints the result. Nothing of the installation is needed for that any more.
"""

import json
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple, TextIO

from piezod.daemon.paths import StagePaths
from piezod.daemon.safe.rescue import Rescue
from piezod.errors import PiezodError

READY: Final = "ready\n"
RAMP: Final = "ramp\n"

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ignored: they are for the supervisor, which may need this process until its end."""


def main(paths: StagePaths, config_file: Path) -> None:
    """Wait for the supervisor's word or its end.

    Args:
        paths: The files of the stage.
        config_file: The accepted copy of its configuration.

    Raises:
        PiezodError: If configuration or drivers cannot be loaded.
    """
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    with _answers() as answers:
        rescue = Rescue(config_file, paths)
        _tell(answers, READY)
        while sys.stdin.readline() == RAMP:
            _tell(answers, json.dumps(_ramp(rescue)._asdict()) + "\n")
    result = _ramp(rescue, unless_clean=True)
    for line in (*result.reached, *result.left):
        _tell(sys.stderr, f"piezod: the daemon was killed; {line}\n")


def _answers() -> TextIO:
    """Return the stream of the answers; what drivers print goes to the log."""
    sys.stdout.flush()
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return answers


def _tell(stream: TextIO, text: str) -> None:
    with suppress(OSError):  # nobody reads it any more, or the terminal was closed
        stream.write(text)
        stream.flush()


class _Result(NamedTuple):
    """Lines of the axes that are at their safe voltages, and of those that are not."""

    reached: list[str]
    left: list[str]


def _ramp(rescue: Rescue, *, unless_clean: bool = False) -> _Result:
    try:
        outcomes = rescue.ramp(unless_clean=unless_clean)
    except (PiezodError, OSError) as error:
        return _Result([], rescue.left_untouched(str(error)))
    return _Result(rescue.reached(outcomes), rescue.left(outcomes))


if __name__ == "__main__":
    name, *folders, file = sys.argv[1:]
    main(StagePaths(name, *map(Path, folders)), Path(file))
