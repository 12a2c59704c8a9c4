"""A process that saves parameters again and again until it is killed.

For each line on its input it forks a child, which prints its process id and then the number of each
save. When the child has been killed, the parent prints "gone". `test_parameter_crash` starts it.
"""

import os
import sys
from itertools import count
from pathlib import Path

from piezod.control.law.model_files import from_model_file
from piezod.daemon.stores.parameter_store import ParameterStore
from tests.daemon.stored import MODEL, WHEN, parameters


def save_for_ever(folder: Path) -> None:
    """Save parameters, each with its number as sensor zero."""
    report(os.getpid())
    store = ParameterStore(folder, "rig 1", lambda: WHEN)
    newest = store.load().document
    for number in count(1 if newest is None else newest.sequence + 1):
        report(store.save(parameters(float(number)), "saver"))


def report(what: object) -> None:
    """Write a line in one piece."""
    os.write(1, f"{what}\n".encode())


if __name__ == "__main__":
    from_model_file(MODEL)  # compile and load now, else each child would have to
    for _ in sys.stdin:
        child = os.fork()
        if not child:
            save_for_ever(Path(sys.argv[1]))
        os.waitpid(child, 0)
        report("gone")
