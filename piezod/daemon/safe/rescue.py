"""A rescue: a stage without a loop is brought to its safe voltage by what its daemon has left.

Whatever a ramp needs is loaded when the object is made; nothing is opened before `ramp`. So a
rescue works when the installation has been moved or replaced meanwhile.
"""

import signal
from collections.abc import Mapping
from contextlib import suppress
from math import isfinite, isnan
from pathlib import Path
from typing import Final

from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.daemon.clock import MonotonicClock
from piezod.daemon.durations import loop_gone_within_s
from piezod.daemon.last_output import LastOutputReader, LastOutputWriter, stays
from piezod.daemon.lock import device_lock, taken_within
from piezod.daemon.noted_identities import noted_identities
from piezod.daemon.paths import StagePaths
from piezod.daemon.safe.ramp import AxisOutcome
from piezod.daemon.safe.ramp_down import Noted, load_drivers, ramp_down
from piezod.devices import registry

UNKNOWN: Final = "the voltage is UNKNOWN"


class Rescue:
    """A rescue that has everything loaded and opens nothing before `ramp`.

    Args:
        config_file: The configuration that the daemon runs or ran.
        paths: The files of the stage; its folders exist.

    Raises:
        ConfigError: If the configuration is not valid.
        RegistryError: If a driver cannot be loaded.
        OSError: If a file cannot be read.
    """

    def __init__(self, config_file: Path, paths: StagePaths) -> None:
        self.config: DaemonConfig = load_daemon(config_file, registry)
        load_drivers(self.config)
        self._paths = paths
        self._output = LastOutputReader(paths.output_map)

    def ramp(
        self, *, unless_clean: bool = False, confirmed: bool = False
    ) -> dict[str, AxisOutcome]:
        """Ramp the stage down once no loop has its devices; SIGTERM does not interrupt that.

        Args:
            unless_clean: Whether to do nothing if the daemon has ended in order by then.
            confirmed: Whether a person answers for the read-backs, whatever was written last.

        Returns:
            The outcome of each axis; none if there was nothing to do.

        Raises:
            AlreadyRunningError: If another process keeps the devices.
            PiezodError: If a device that drives an axis is no amplifier.
            OSError: If the lock cannot be opened.
        """
        # A loop process whose supervisor died drives until it has ramped down.
        within_s = loop_gone_within_s(self.config)
        with taken_within(lambda: device_lock(self._paths.loop_lock), within_s):
            if unless_clean and not self._paths.running.exists():
                return {}
            # A service manager that stops a daemon also signals its children.
            before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
            try:
                identities = noted_identities(self._paths.identities)
                clean = not self._paths.running.exists()
                known = Noted(self.last_v(), identities, clean=clean)
                clock = MonotonicClock()
                outcomes = ramp_down(self.config, known, within_s, clock, confirmed=confirmed)
                note_outcomes(self._paths.output_map, outcomes, clock.now_ns())
                return outcomes
            finally:
                signal.signal(signal.SIGTERM, before)

    def last_v(self) -> dict[str, float]:
        """Return the last written voltage of each axis, in V; NaN if it is not known."""
        return self._output.of(self.config.axes)

    def left(self, outcomes: Mapping[str, AxisOutcome]) -> list[str]:
        """Return a line for each axis that is not at its safe voltage: why, and what stays."""
        last_v = self.last_v()
        return [
            f"axis {name}: {UNKNOWN}: {each.why}; {_stays(each, last_v[name])}"
            for name, each in outcomes.items()
            if each.why
        ]

    def reached(self, outcomes: Mapping[str, AxisOutcome]) -> list[str]:
        """Return a line for each axis that is at its safe voltage: from where it came."""
        return [f"{name}: {_way(each)}" for name, each in outcomes.items() if not each.why]

    def left_untouched(self, why: str) -> list[str]:
        """Return such a line for each axis, if no amplifier could be opened."""
        return [
            f"axis {name}: {UNKNOWN}: {why}; {stays(drive_v)}"
            for name, drive_v in self.last_v().items()
        ]


def note_outcomes(output_map: Path, outcomes: Mapping[str, AxisOutcome], t_ns: int) -> None:
    """Store what was written last on each axis: the next daemon compares its read-back with it.

    Args:
        output_map: File of the last output.
        outcomes: The outcome of every axis of the stage.
        t_ns: The present instant, in ns.
    """
    with suppress(OSError):  # the folder may have been removed; then nothing is known
        written_v = [each.written_v for each in outcomes.values()]
        writer = LastOutputWriter(output_map, len(outcomes))
        writer.note(written_v, t_ns)
        for axis, drive_v in enumerate(written_v):
            if isnan(drive_v):
                writer.forget(t_ns, axis)


def _way(outcome: AxisOutcome) -> str:
    noted = "as last written, or as you confirm; the amplifier has no read-back"
    source = noted if outcome.from_noted else "read back"
    end_v = outcome.read_back_v
    end = f"{end_v:z.2f} V read back" if isfinite(end_v) else "not read back"
    return f"from {outcome.from_v:z.2f} V ({source}) to {outcome.safe_v:zg} V, {end}"


def _stays(outcome: AxisOutcome, last_v: float) -> str:
    if isfinite(outcome.read_back_v):
        return f"the voltage stays at {outcome.read_back_v:z.2f} V, as read back"
    if isfinite(outcome.written_v):
        return f"the voltage stays at {outcome.written_v:z.2f} V, as last written"
    return stays(last_v)
