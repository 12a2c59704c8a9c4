"""Exchanges the configuration of a running stage: all of it, or nothing.

A second loop process accepts the new configuration while the first one runs. The exchange ends the
first and starts the second. If the second does not start, a loop with the old configuration does.
"""

import asyncio
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from piezod.config.daemon import DaemonConfig
from piezod.config.states import State
from piezod.daemon.logging import logger
from piezod.daemon.noted_identities import note_identities, noted_identities
from piezod.daemon.paths import StagePaths
from piezod.daemon.stage.errors import BadValueError, NotNowError
from piezod.daemon.supervisor.loop_run import LoopRun
from piezod.errors import ConfigError, PiezodError

UP_WITHIN_S: Final = 60.0
"""How long a loop may take to its first cycle, in s; compiling may take most of it."""
AT_REST: Final = (State.SAFE, State.FAULT, State.BLIND)
"""States in which nothing is driven."""
_LEARNED_WITH: Final = ("sensor", "amplifier", "compensator")
"""Keys of an axis; if one changes, zero and learned weights have no meaning. A changed model
replaces the weights only."""
_POLL_S: Final = 0.02

_log = logger("supervisor")


async def prepare(
    run: LoopRun, paths: StagePaths, source: Path, *, strict_rt: bool = False
) -> LoopRun:
    """Let a second loop process accept a configuration; it drives nothing before it is started.

    Args:
        run: The running loop.
        paths: The files of the stage.
        source: The configuration file.
        strict_rt: Whether to set `loop.strict_rt`, whatever the file says.

    Raises:
        BadValueError: If it is not valid; the text has every problem.
        NotNowError: If it needs a restart, or the process cannot be started.
    """
    # Two folders by turns: the copy of the running loop stays, for `piezod safe` and a way back.
    slot = "config-b" if run.config_file.parent.name == "config-a" else "config-a"
    try:
        # Warm: there is no loop from the end of the old one to the first cycle of the new one.
        fresh = LoopRun(paths, source, slot, strict_rt=strict_rt, warm=True)
        await asyncio.to_thread(fresh.accept)
    except ConfigError as error:
        raise BadValueError(str(error), "the configuration in force is kept; correct it") from error
    except (PiezodError, OSError) as error:
        raise NotNowError(
            f"the configuration was not exchanged: {error}", "look at the log and at the disk"
        ) from error
    # Rings, recordings and leases depend on the axes.
    old, new = run.config.shown_axes, fresh.config.shown_axes
    if new != old:
        fresh.discard()
        what = f"its axes are {', '.join(new)}, those in force are {', '.join(old)}"
        raise NotNowError(what, "axes are exchanged by a restart only")
    return fresh


def changes(old: LoopRun, new: LoopRun) -> list[str]:
    """Return the paths of all values that differ between two configurations, sorted.

    Model files are compared by contents, wherever they are, and the files of drivers by place and
    contents.
    """
    before, after = _flat(_contents(old)), _flat(_contents(new))
    return sorted(key for key in before.keys() | after.keys() if before.get(key) != after.get(key))


def _contents(run: LoopRun) -> dict[str, Any]:
    """Return an accepted configuration with the contents of model files instead of their paths.

    The path of a driver's file is followed by the digest of its contents.
    """
    kept: dict[str, Any] = json.loads(run.config_file.read_text(encoding="utf-8"))
    for axis in kept["axes"].values():
        if "model" in axis:
            axis["model"] = Path(axis["model"]).read_bytes()
    named = run.source_files.named
    for device in kept["devices"].values():
        options = device.get("options", {})
        options |= {
            key: f"{value} {named[value]}"
            for key, value in options.items()
            if isinstance(value, str) and value in named
        }
    return kept


def _flat(document: dict[str, Any], path: str = "") -> dict[str, Any]:
    """Return the values of nested documents by their paths, as in "axes.x.model"."""
    flat: dict[str, Any] = {}
    for key, value in document.items():
        inner = f"{path}.{key}" if path else key
        flat |= _flat(value, inner) if isinstance(value, dict) else {inner: value}
    return flat


def kept_axes(config: DaemonConfig, different: Sequence[str]) -> set[str]:
    """Return the axes whose learned parameters a changed configuration does not concern.

    Args:
        config: The configuration in force.
        different: The paths of all values that change, from `changes`.
    """
    if any(path.startswith("devices.") for path in different):
        return set()
    changed = {tuple(path.split(".")[1:3]) for path in different if path.startswith("axes.")}
    return {
        name for name in config.axes if not any((name, key) in changed for key in _LEARNED_WITH)
    }


def _forget_identities(path: Path, different: Sequence[str]) -> None:
    """Remove the stored identities of devices whose configuration changes: others are meant."""
    changed = {place.split(".")[1] for place in different if place.startswith("devices.")}
    try:
        known = noted_identities(path)
        if changed & known.keys():
            note_identities(path, {name: known[name] for name in known.keys() - changed})
    except OSError as error:  # the new loop then waits for the old device, and says so
        _log.error("identities not changed", why=str(error))


async def exchange(
    run: LoopRun, paths: StagePaths, fresh: LoopRun, use: Callable[[LoopRun], None]
) -> bool:
    """End a loop that drives nothing, and start another one in its place.

    Args:
        run: The running loop.
        paths: The files of the stage.
        fresh: Its successor, from `prepare`.
        use: Called with each loop just before it is started; from then on it is supervised.

    Returns:
        Whether the new loop started; otherwise a loop with the old configuration was started.

    Raises:
        StageError: If the new loop has no shared memory; then the old one runs on. Or if the loop
            with the old configuration could not be started.
    """
    succession = run.loop.succession()
    _make_memory(fresh)
    # Never both: they would drive the same devices.
    await _end(run)
    await asyncio.to_thread(_forget_identities, paths.identities, changes(run, fresh))
    use(fresh)
    await asyncio.to_thread(run.rescuer.end)  # the new loop has its own
    fresh.start(succession)
    if await _up(fresh):
        return True
    await _end(fresh)
    back = await prepare(run, paths, run.config_file)  # the copy, not the file, which has changed
    back.source_files = run.source_files
    use(back)
    await asyncio.to_thread(fresh.rescuer.end)
    back.start(succession)
    return False


def _make_memory(fresh: LoopRun) -> None:
    """Make the shared memory of a loop, while the loop before it still runs."""
    try:
        fresh.loop.beat(time.monotonic_ns())
    except OSError as error:
        fresh.discard()
        what = f"the configuration was not exchanged: {error}"
        raise NotNowError(what, "look at the log and at the disk") from error


async def _end(run: LoopRun) -> None:
    while run.exit_code is None:
        if not run.request_end():
            run.kill()  # nothing is driven at rest
        await asyncio.sleep(_POLL_S)


async def _up(run: LoopRun) -> bool:
    """Wait for the first cycle; the caller's `_watch` updates the health of the loop."""
    loop = asyncio.get_running_loop()
    end_s = loop.time() + UP_WITHIN_S
    while run.exit_code is None and loop.time() < end_s:
        if run.loop.health.started:
            return True
        await asyncio.sleep(_POLL_S)
    return False
