"""The player of a soak's rig: it plays tables by its own clock, and its output may fail meanwhile.

It does not record the sensor: the record of a play has no valid sample.
"""

from collections.abc import Callable
from math import nan
from typing import Final

import numpy as np

from piezod.devices.played_axis import FloatArray
from piezod.devices.player import (
    AtEnd,
    Check,
    PlayedRecord,
    PlayerCapabilities,
    PlayState,
    Progress,
    Table,
    go_on,
)
from piezod.errors import DeviceError
from piezod.testing.injections import InjectionKind
from piezod.units import NS_PER_S
from tests.control.judged_device import ROUNDING_V, JudgedDevice

INTERVAL_NS: Final = 1_000_000
PER_MESSAGE: Final = 50
MESSAGE_S: Final = 0.05


class TablePlayer(JudgedDevice):
    """Implements `Player` for a device with one output.

    `pause` lets a time pass, in s: a table is loaded message by message.
    """

    pause: Callable[[float], None] = staticmethod(lambda _s: None)
    _table = Table(INTERVAL_NS, np.empty((0, 1)), np.empty((0, 1)), 1)
    _state = PlayState.IDLE
    _owed = False

    def player_capabilities(self) -> PlayerCapabilities:
        """Return the capabilities."""
        numbers = (INTERVAL_NS, INTERVAL_NS, NS_PER_S, 100_000)
        return PlayerCapabilities(
            *numbers, False, (0.0,), 1000, False, 100_000, True, at_end=AtEnd.HOLDS
        )

    def load(self, table: Table, check: Check = go_on) -> Table:
        """Take a table, message by message."""
        for _ in range(1 + len(table.period) // PER_MESSAGE):
            check()
            self.pause(MESSAGE_S)
        self._table, self._state = table, PlayState.LOADED
        return table

    def arm(self) -> None:
        """Prepare the start."""
        self._state = PlayState.ARMED

    def start(self, now_ns: int) -> None:
        """Start the play, and judge its first point."""
        if self._is_lost(now_ns) or self._any(InjectionKind.REFUSED, now_ns):
            raise DeviceError("the device does not start")
        drive_v = self._voltages()
        self.judge_start(drive_v[0], now_ns)
        self._check_table(drive_v)
        step_ns = self._table.interval_ns
        self.output.play((now_ns + i * step_ns, each) for i, each in enumerate(drive_v))
        self._state, self._owed = PlayState.PLAYING, False

    def replace(self, period: FloatArray) -> FloatArray:
        """Refuse: it replaces nothing."""
        raise DeviceError(f"a table of {len(period)} points is not replaced")

    def progress(self, now_ns: int) -> Progress:
        """Return the progress."""
        if self._is_lost(now_ns):
            return Progress(PlayState.FAILED, 0, "the device is lost")
        if self._state is PlayState.PLAYING and not self.output.plays(now_ns):
            self._state = PlayState.ENDED
        return Progress(self._state, 0)

    def abort(self, now_ns: int) -> tuple[float, ...]:
        """Stop the play; a lost device stops it when it is there again."""
        self._owed = self._is_lost(now_ns)
        if self._owed:
            return (nan,)
        self._state = PlayState.IDLE
        self.output.play(())
        return (self.read_back(now_ns)[0],)

    def recording(self, check: Check = go_on) -> PlayedRecord:
        """Return a record without valid samples."""
        check()
        self.pause(MESSAGE_S)
        samples = np.full((len(self._table.period), 1), nan)
        return PlayedRecord(self._table.interval_ns, samples, 0, np.empty((len(samples), 0)))

    def stop_owed(self, now_ns: int) -> bool:
        """Stop a play whose abort was lost; return whether it still goes on."""
        if self._owed:
            self.abort(now_ns)
        return self._owed

    def _voltages(self) -> list[float]:
        lead_in, period = self._table.lead_in[:, 0], self._table.period[:, 0]
        return [*lead_in.tolist(), *period.tolist() * self._table.cycles]

    def _check_table(self, drive_v: list[float]) -> None:
        reach_v = self.limits.slew_v_per_s * self._table.interval_ns / NS_PER_S + ROUNDING_V
        step_v = float(np.abs(np.diff(drive_v)).max(initial=0.0))
        if step_v > reach_v:
            self.violations.append(f"a table has a step of {step_v:.4g} V, allowed: {reach_v:.4g}")

    def _is_lost(self, now_ns: int) -> bool:
        return self._any(InjectionKind.LOST, now_ns)
