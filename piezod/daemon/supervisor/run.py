"""Runs a stage, from its configuration file to the end of its daemon."""

import asyncio
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from piezod.daemon.background import BackgroundStream
from piezod.daemon.descriptors import raise_limit
from piezod.daemon.durations import ramped_down_within_s
from piezod.daemon.lock import Lock
from piezod.daemon.logging import logger, set_up_logging
from piezod.daemon.paths import StagePaths
from piezod.daemon.supervisor.loop_run import LoopRun, RampDown
from piezod.daemon.supervisor.marker import Marker
from piezod.daemon.supervisor.notify import Notifier, fed
from piezod.daemon.supervisor.signals import Signals
from piezod.daemon.supervisor.terms import Ending, RunOptions
from piezod.errors import DeviceUnavailableError
from piezod.telemetry.words import HUNG

if TYPE_CHECKING:
    from piezod.daemon.supervisor.supervisor import Supervisor

_log = logger("supervisor")


def run_stage(
    source: Path, options: RunOptions, paths: StagePaths, lock: Lock, signals: Signals
) -> bool:
    """Run the daemon of a stage until a shutdown is requested or its loop is lost.

    Args:
        source: The configuration file.
        options: Options of the command line.
        paths: The files of the stage.
        lock: Its lock, taken before anything else; released while `piezod safe` runs.
        signals: The signals that were received.

    Returns:
        Whether the run ended in order, with the output at the safe voltage.

    Raises:
        ConfigError: If the configuration is not valid; no device was opened.
        PiezodError: If the loop process ended before it had read the configuration, or if this
            process may not open enough files.
        AlreadyRunningError: If another daemon took the lock while `piezod safe` had it.
        DeviceUnavailableError: If a required device was absent.
        OSError: If a file of the stage cannot be made.
    """
    with BackgroundStream(sys.stderr) as log:
        set_up_logging(log)
        raise_limit()
        return _run_stage(source, options, paths, lock, signals)


def _run_stage(
    source: Path, options: RunOptions, paths: StagePaths, lock: Lock, signals: Signals
) -> bool:
    marker = Marker(paths.running)
    _log.info("starting", stage=paths.name)
    run = LoopRun(paths, source, "config-a", strict_rt=options.strict_rt)
    # Imported while that process loads.
    from piezod.daemon.supervisor.supervisor import Supervisor  # noqa: PLC0415 - see above

    if not run.accept(lambda: bool(signals.end) and not marker.unclean):
        return True  # no device was touched
    # Before the loop starts: then an end without `remove` leaves the mark.
    marker.put()
    notifier = Notifier()
    if marker.unclean:  # a voltage of the last run may still be in force
        lock.release()
        notifier.take_longer(ramped_down_within_s(run.config), "ramping down after the last run")
        safe = RampDown(source, run.config).wait()
        if signals.end:
            run.discard()
            return safe  # the mark stays: no operator has looked at the stage yet
        lock.take()
    try:
        supervisor = Supervisor(source, paths, run, options, notifier, signals)
        last_end = HUNG if marker.hung else int(marker.unclean)
        ending, safe = asyncio.run(_run(supervisor, lock, notifier, last_end))
    except OSError:  # a file of the stage cannot be made
        if not run.started:  # it may have no shared memory to ask for its cycles
            run.discard()
            if not marker.unclean:
                marker.remove()
        raise
    if supervisor.loop_hung:
        marker.note_hung()
    if ending is Ending.LOST:
        _remove(marker, supervisor.loop_run)
    if ending in (Ending.IN_ORDER, Ending.ABSENT):
        paths.loop_map.unlink(missing_ok=True)
        # Without its device this run cannot have ended what an unclean one left in force.
        if supervisor.loop_run.loop.devices_opened or not marker.unclean:
            marker.remove()
    if ending is Ending.ABSENT:
        raise DeviceUnavailableError("a device of this stage is absent; the log says which")
    return ending is Ending.IN_ORDER or (ending is Ending.UNSAFE and safe)


def _remove(marker: Marker, run: LoopRun) -> None:
    """Remove the mark of a run that has driven nothing, unless the one before has left it."""
    if run.idle and not marker.unclean:
        marker.remove()


async def _run(
    supervisor: "Supervisor", lock: Lock, notifier: Notifier, last_end: int
) -> tuple[Ending, bool]:
    """Run the supervisor; if the loop does not leave the stage safe, ramp down before all else.

    Returns:
        How it ended, and whether the output is known to be at the safe voltage.
    """
    try:
        ending = await supervisor.run(last_end=last_end)
    except BaseException:
        await supervisor.close()  # without a beat the loop ramps down by itself
        raise
    async with fed(notifier):
        safe = ending is Ending.IN_ORDER
        if ending in (Ending.IN_ORDER, Ending.ABSENT):
            await supervisor.close()
        else:
            # The ramp before `close`, which writes files and may take a while.
            lock.release()
            ramp_down = RampDown(supervisor.loop_run.config_file, supervisor.loop_run.loop.config)
            await supervisor.close()
            safe = await asyncio.to_thread(ramp_down.wait)
        # A file whose writing had begun when the run ended.
        await asyncio.get_running_loop().shutdown_default_executor()
    return ending, safe
