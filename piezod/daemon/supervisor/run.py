"""A stage from its configuration file to the end of its daemon."""

import asyncio
from pathlib import Path

from piezod.daemon.durations import ramped_down_within_s
from piezod.daemon.lock import Lock
from piezod.daemon.logging import set_up_logging
from piezod.daemon.paths import StagePaths
from piezod.daemon.supervisor.loop_run import LoopRun, RampDown
from piezod.daemon.supervisor.marker import Marker
from piezod.daemon.supervisor.notify import Notifier
from piezod.daemon.supervisor.signals import Signals
from piezod.daemon.supervisor.supervisor import Supervisor
from piezod.daemon.supervisor.terms import Ending, RunOptions
from piezod.errors import DeviceUnavailableError


def run_stage(
    source: Path, options: RunOptions, paths: StagePaths, lock: Lock, signals: Signals
) -> bool:
    """Run the daemon of a stage until it is told to stop, or its loop is gone.

    Args:
        source: The configuration file.
        options: What the command line adds to it.
        paths: The files of the stage.
        lock: Its lock, which was taken before anything else; released where `piezod safe` is run.
        signals: What signals have asked for, and will.

    Returns:
        Whether it ended in order, the output at the safe voltage.

    Raises:
        ConfigError: If the configuration is not valid; no device was opened.
        PiezodError: If the loop process ended before it had read the configuration.
        AlreadyRunningError: If somebody else came first while an earlier run was cleared up.
        DeviceUnavailableError: If a device had to be there and was absent.
        OSError: If a file of the stage cannot be made.
    """
    set_up_logging()
    marker = Marker(paths.running)
    run = LoopRun(paths, source, "config-a", strict_rt=options.strict_rt)
    if not run.accept(lambda: bool(signals.end) and not marker.unclean):
        return True  # nothing has been touched
    marker.put()
    if marker.unclean:  # whoever died may have left a voltage in force, and nobody saw to it since
        lock.release()
        Notifier().take_longer(ramped_down_within_s(run.config), "ramping down after the last run")
        safe = RampDown(source, run.config).wait()
        if signals.end:
            run.discard()
            return safe  # the mark stays: nobody has looked yet
        lock.take()
    supervisor = Supervisor(source, paths, run, options, Notifier(), signals)
    ending, safe = asyncio.run(_run(supervisor, lock, unclean=marker.unclean))
    if ending in (Ending.IN_ORDER, Ending.ABSENT):
        paths.loop_map.unlink(missing_ok=True)
        # What an earlier run left in force nobody has seen to where there was no device.
        if supervisor.run_of_loop.loop.opened or not marker.unclean:
            marker.remove()
    if ending is Ending.ABSENT:
        raise DeviceUnavailableError("a device of this stage is absent; the log says which")
    return ending is Ending.IN_ORDER or (ending is Ending.UNSAFE and safe)


async def _run(supervisor: Supervisor, lock: Lock, *, unclean: bool) -> tuple[Ending, bool]:
    """Run; where the loop did not leave the stage safe, have that done before all else.

    Returns:
        How it ended, and whether the output is known to be at the safe voltage.
    """
    try:
        ending = await supervisor.run(unclean=unclean)
    except BaseException:
        await supervisor.close()  # the loop goes to the safe voltage when it hears no more of us
        raise
    if ending in (Ending.IN_ORDER, Ending.ABSENT):
        await supervisor.close()
        return ending, ending is Ending.IN_ORDER
    lock.release()
    ramp_down = RampDown(supervisor.run_of_loop.config_file, supervisor.run_of_loop.loop.config)
    await supervisor.close()
    return ending, ramp_down.wait()
