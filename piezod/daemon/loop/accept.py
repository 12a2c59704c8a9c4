"""Accepting a configuration: the first thing that a loop process does, before it opens a device.

Only the loop process loads drivers and the control law, so that the supervisor stays small and runs
no code of a driver. The process writes the accepted copy, prints one line of JSON, and waits for a
line on its standard input before it goes on; at the end of the input it ends.
"""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

from piezod import __version__
from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.control.assembly import check_stage
from piezod.daemon import accepted_config
from piezod.devices import registry
from piezod.errors import ConfigError, DataError, ModelError, Problem


def load(
    path: Path, *, strict_rt: bool = False, named_files: dict[str, str] | None = None
) -> DaemonConfig:
    """Read and check the configuration of a stage; opens no device.

    Args:
        path: The file.
        strict_rt: Whether to set `loop.strict_rt`, whatever the file says.
        named_files: Gets the digest of each file that the configuration names, by its absolute
            path; None to drop them.

    Raises:
        ConfigError: If it is not valid, or a gain in it is not safe.
    """
    config = load_daemon(path, registry, named_files)
    try:
        check_stage(config)
    except (DataError, ModelError) as error:
        raise ConfigError(Problem(str(path), 0, 0, "", str(error))) from error
    if strict_rt:
        loop = config.loop.model_copy(update={"strict_rt": True})
        config = config.model_copy(update={"loop": loop})
    return config


def accept(
    source: Path,
    copy: Path,
    *,
    strict_rt: bool,
    prepare: Callable[[DaemonConfig], None] | None = None,
) -> DaemonConfig | None:
    """Accept a configuration, report that, and wait for the word to go on.

    Args:
        source: The configuration file.
        copy: Path of the accepted copy; its folder is replaced.
        strict_rt: Whether to set `loop.strict_rt`, whatever the file says.
        prepare: Called with an accepted configuration before that is reported; None for nothing.

    Returns:
        The configuration; None if it was refused, if the copy cannot be written, or if the process
        is to end.
    """
    named_files: dict[str, str] = {}
    try:
        config = load(source, strict_rt=strict_rt, named_files=named_files)
    except ConfigError as error:
        _report({"problems": error.problems})
        return None
    try:
        accepted_config.keep(config, copy.parent, copy.stem)
    except OSError as error:  # the disk is full
        _report({"failed": [error.errno, error.strerror, error.filename]})
        return None
    if prepare is not None:
        prepare(config)
    document = accepted_config.document(config)
    _report({"accepted": document, "named_files": named_files, "version": __version__})
    return config if sys.stdin.readline() else None


def _report(line: dict[str, object]) -> None:
    """Print the only line on standard output; whatever is printed later goes to the log."""
    print(json.dumps(line), flush=True)
    os.dup2(2, 1)
