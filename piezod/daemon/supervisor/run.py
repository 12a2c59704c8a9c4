"""Runs a stage, from its configuration file to the end of its daemon."""

import asyncio
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from piezod.daemon.background import BackgroundStream
from piezod.daemon.descriptors import raise_limit
from piezod.daemon.durations import ramped_down_within_s
from piezod.daemon.logging import logger, set_up_logging
from piezod.daemon.paths import StagePaths
from piezod.daemon.supervisor.loop_run import LoopRun
from piezod.daemon.supervisor.marker import Marker
from piezod.daemon.supervisor.notify import Notifier, fed
from piezod.daemon.supervisor.signals import Signals
from piezod.daemon.supervisor.terms import Ending, RunOptions
from piezod.errors import DeviceUnavailableError, StillDrivenError
from piezod.telemetry.words import HUNG

if TYPE_CHECKING:
    from piezod.daemon.supervisor.supervisor import Supervisor

_log = logger("supervisor")


def run_stage(source: Path, options: RunOptions, paths: StagePaths, signals: Signals) -> bool:
    """Run the daemon of a stage until a shutdown is requested or its loop is lost.

    The caller holds the lock of the stage, until after the end.

    Args:
        source: The configuration file.
        options: Options of the command line.
        paths: The files of the stage.
        signals: The signals that were received.

    Returns:
        Whether the run ended in order, with the output at the safe voltage.

    Raises:
        ConfigError: If the configuration is not valid; no device was opened.
        PiezodError: If the loop process ended before it had read the configuration, or if this
            process may not open enough files.
        DeviceUnavailableError: If a required device was absent.
        StillDrivenError: If the stage could not be brought to its safe voltage; the text says which
            voltage stays on which axis.
        OSError: If a file of the stage cannot be made.
    """
    with BackgroundStream(sys.stderr) as log:
        set_up_logging(log)
        raise_limit()
        return _run_stage(source, options, paths, signals)


def _run_stage(source: Path, options: RunOptions, paths: StagePaths, signals: Signals) -> bool:
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
        notifier.take_longer(ramped_down_within_s(run.config), "ramping down after the last run")
        run.rescuer.begin()
        left = run.rescuer.wait()
        if signals.end:
            run.discard()
            _refuse(left)
            return True  # the mark stays: no operator has looked at the stage yet
    try:
        supervisor = Supervisor(source, paths, run, options, notifier, signals)
        last_end = HUNG if marker.hung else int(marker.unclean)
        ending, left = asyncio.run(_run(supervisor, notifier, last_end))
    except OSError:  # a file of the stage cannot be made
        if not run.started:  # it may have no shared memory to ask for its cycles
            run.discard()
            if not marker.unclean:
                marker.remove()
        raise
    if supervisor.loop_hung:
        marker.note_hung()
    try:
        _tidy_up(ending, marker, supervisor.loop_run, paths)
    except OSError as error:  # its folder is gone; that must not hide how the run ended
        _log.error("files left", why=str(error))
    supervisor.loop_run.rescuer.end()
    if ending is Ending.ABSENT:
        raise DeviceUnavailableError("a device of this stage is absent; the log says which")
    _refuse(left)
    return ending is not Ending.LOST


def _refuse(left: list[str]) -> None:
    """Refuse to end as if nothing were driven.

    Raises:
        StillDrivenError: If there is an axis that is not at its safe voltage.
    """
    if left:
        raise StillDrivenError("\n".join(left))


def _tidy_up(ending: Ending, marker: Marker, run: LoopRun, paths: StagePaths) -> None:
    """Remove the files of a run that left nothing in force, and its mark.

    Raises:
        OSError: If one cannot be removed.
    """
    if ending is Ending.LOST and run.idle and not marker.unclean:
        marker.remove()  # it has driven nothing
    if ending in (Ending.IN_ORDER, Ending.ABSENT):
        # Without its device this run cannot have ended what an unclean one left in force.
        if run.loop.devices_opened or not marker.unclean:
            marker.remove()
        paths.loop_map.unlink(missing_ok=True)


async def _run(
    supervisor: "Supervisor", notifier: Notifier, last_end: int
) -> tuple[Ending, list[str]]:
    """Run the supervisor; if the loop does not leave the stage safe, ramp down before all else.

    Returns:
        How it ended, and a line for each axis that is not at its safe voltage.
    """
    try:
        ending = await supervisor.run(last_end=last_end)
    except BaseException:
        await supervisor.close()  # without a beat the loop ramps down by itself
        raise
    left: list[str] = []
    async with fed(notifier):
        if ending in (Ending.IN_ORDER, Ending.ABSENT):
            await supervisor.close()
        else:
            # The ramp before `close`, which writes files and may take a while.
            rescuer = supervisor.loop_run.rescuer
            rescuer.begin()
            await supervisor.close()
            left = await asyncio.to_thread(rescuer.wait)
            if left:
                notifier.status("; ".join(left))
        # A file whose writing had begun when the run ended.
        await asyncio.get_running_loop().shutdown_default_executor()
    return ending, left
