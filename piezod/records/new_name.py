"""Names for what was measured: it cannot be computed again, so it replaces nothing."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path


@contextmanager
def new_folder(wanted: Path) -> Iterator[Path]:
    """Yield a folder of its own: `wanted`, or with a number if that name is taken.

    It is removed at the end if it is empty. A link of that name is a taken name.

    Args:
        wanted: Path of the folder; its parents are made if they are absent.

    Raises:
        OSError: If the folder cannot be made.
    """
    made = _first_free(wanted, "", Path.mkdir)
    try:
        yield made
    finally:
        with suppress(OSError):  # it has results
            made.rmdir()


@contextmanager
def new_file(wanted: Path) -> Iterator[Path]:
    """Yield the path of a new empty file: `wanted`, or with a number before its ending.

    It is removed at the end if nothing was written. A link of that name is a taken name.

    Args:
        wanted: Path of the file; its parents are made if they are absent.

    Raises:
        OSError: If the file cannot be made.
    """
    made = _first_free(wanted, wanted.suffix, partial(Path.touch, exist_ok=False))
    try:
        yield made
    finally:
        if made.exists() and not made.stat().st_size:
            made.unlink()


def _first_free(wanted: Path, ending: str, make: Callable[[Path], object]) -> Path:
    """Make the first path that is free: a call that fails if anything has that name."""
    if wanted.name in {"", ".."}:  # as of ".": its number needs a name
        wanted = wanted.resolve()
    wanted.parent.mkdir(parents=True, exist_ok=True)
    path, number = wanted, 1
    while True:
        try:
            make(path)
        except FileExistsError:
            number += 1
            path = wanted.with_name(f"{wanted.name.removesuffix(ending)}-{number}{ending}")
        else:
            return path


def free_name(wanted: Path) -> Path:
    """Return a path that nothing has: `wanted`, or with a number before its ending."""
    path, number = wanted, 1
    while os.path.lexists(path):
        number += 1
        path = wanted.with_name(f"{wanted.stem}-{number}{wanted.suffix}")
    return path
