"""A device on a wire that also plays tables: it enforces the order of a play."""

import typing
from collections.abc import Callable, Sequence
from math import nan
from typing import Final, TypeVar, TypeVarTuple

from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.bus.dialogue import Dialogue, ExchangingDialogue
from piezod.devices.bus.line import LineFault
from piezod.devices.bus.play_dialogue import PlayDialogue
from piezod.devices.bus.table_check import check_table
from piezod.devices.interface import Identity, Sample
from piezod.devices.player import (
    Check,
    PlayedRecord,
    PlayerCapabilities,
    PlayState,
    Progress,
    Table,
    go_on,
)
from piezod.errors import DeviceError
from piezod.units import NS_PER_S

if typing.TYPE_CHECKING:
    from piezod.devices.player import FloatArray

AnswerT = TypeVar("AnswerT")
Given = TypeVarTuple("Given")

OVERDUE_NS: Final = 10 * NS_PER_S
"""A play has failed if its next cycle is later than its duration, 1 % of it, and this."""


class PlayingBusDevice(BusDevice):
    """A `BusDevice` that implements `Player`.

    A play that was begun counts as going on until its end or its stop is confirmed. Therefore
    writes are refused after a failure, too, until `abort` has reached the device, or the device was
    opened and activated again: `activate` of the dialogue stops a play that it finds. An abort that
    was not confirmed is repeated by each reading; until it is, samples and read-back are unknown.

    Args:
        name: Name in messages.
        dialogue: Exchanges of the protocol.
        play: Exchanges of a play.
    """

    def __init__(self, name: str, dialogue: Dialogue, play: PlayDialogue) -> None:
        super().__init__(name, dialogue)
        self._play = play
        self._player_able: PlayerCapabilities | None = None
        self._progress = Progress(PlayState.IDLE, 0)
        self._may_play = self._stop_owed = False
        self._table: Table | None = None
        self._cycles = self._cycle_ns = self._overdue_ns = 0

    def open(self) -> Identity:
        """Connect and return the identity, as `BusDevice.open`; a begun play has failed."""
        identity = super().open()
        self._player_able = None
        if self._progress.state is PlayState.PLAYING:
            self._fail("the device was opened again during the play")
        return identity

    def activate(self, now_ns: int) -> None:
        """Take control of the outputs at their present values; a play is stopped.

        Raises:
            DeviceError: If it is not open, or refuses control.
        """
        was_active = self._active
        super().activate(now_ns)
        self._may_play &= was_active

    def player_capabilities(self) -> PlayerCapabilities:
        """Return the capabilities as a player.

        Raises:
            DeviceError: If it is not active, or cannot play.
        """
        self._require_active()
        if self._player_able is None:
            self._player_able = self._do("report its memory", self._play.capabilities)
        return self._player_able

    def load(self, table: Table, check: Check = go_on) -> Table:
        """Load a table; return it as the device will play it. The outputs do not change.

        Raises:
            DeviceError: If it does not fit, or a play is going on.
        """
        able = self.player_capabilities()
        if self._may_play:
            raise DeviceError(f"{self._name} may still be playing: abort the play before")
        self._progress, self._table = Progress(PlayState.IDLE, 0), None
        check_table(table, able, self._ranges)
        loaded = self._do("load a table", self._play.load, table, check)
        self._table, self._progress = loaded, Progress(PlayState.LOADED, 0)
        return loaded

    def arm(self) -> None:
        """Prepare the start.

        Raises:
            DeviceError: If no table is loaded, or the device refuses.
        """
        self._require_active()
        self._require(PlayState.LOADED, "arm")
        self._do("prepare the start", self._play.arm)
        self._progress = Progress(PlayState.ARMED, 0)

    def start(self, now_ns: int) -> None:
        """Start the play and the record.

        Raises:
            DeviceError: If it is not armed, or the device refuses.
        """
        self._require_active()
        self._require(PlayState.ARMED, "start")
        table = self._table
        assert table is not None  # noqa: S101 - an armed device has one
        self._cycles, self._cycle_ns = table.cycles, len(table.period) * table.interval_ns
        lead_in_ns = len(table.lead_in) * table.interval_ns
        first_ns = lead_in_ns + self._cycle_ns + table.longest_wait_ns
        self._overdue_ns = _limit_ns(now_ns, first_ns)
        # Before the request: whether it has reached the device is unknown after a failure.
        self._may_play, self._stop_owed = True, False
        self._written = [nan] * len(self._written)  # those of before are not in force any more
        self._fail("the start was not confirmed")
        self._do("start", self._play.start)
        self._progress = Progress(PlayState.PLAYING, 0)

    def replace(self, period: "FloatArray") -> "FloatArray":  # noqa: ARG002 - the interface's
        """Refuse: no source states when these devices take new values into use.

        Raises:
            DeviceError: Always.
        """
        raise DeviceError(f"{self._name} cannot replace a table while it plays: load a new one")

    def progress(self, now_ns: int) -> Progress:
        """Return the progress. Call once per cycle. Real-time safe."""
        if self._progress.state is not PlayState.PLAYING:
            return self._progress
        progress = self._try(self._play.progress, now_ns)
        if progress is not None:
            if self._progress.cycle < progress.cycle <= self._cycles:
                self._overdue_ns = _limit_ns(now_ns, self._cycle_ns)
            self._progress = progress
            self._may_play = progress.state is not PlayState.ENDED
        elif self.lost:
            self._fail(self.lost)
        if self._progress.state is PlayState.PLAYING and now_ns > self._overdue_ns:
            self._fail(self.last_fault or "the play does not go on")
        return self._progress

    def abort(self, now_ns: int) -> tuple[float, ...]:
        """Stop the play; return the value in force of each output, NaN if unknown.

        Never raises. Real-time safe.
        """
        if self._able is None:
            return ()
        if self._may_play:
            return self._stop()
        if self._progress.state is not PlayState.ENDED:
            self._progress = Progress(PlayState.IDLE, 0)
        return tuple(self.read_back(now_ns))

    def recording(self, check: Check = go_on) -> PlayedRecord:
        """Return the record of the play that has ended.

        Raises:
            DeviceError: If none has ended, or it cannot be read.
        """
        self._require_active()
        self._require(PlayState.ENDED, "read a record")
        return self._do("read the record", self._play.recording, check)

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return a sample of each input; during a play the newest of its record. Real-time safe."""
        if self._active and self._plays_on():
            # What was sampled of a play that is to stop is not followed any more.
            asked = None if self._stop_owed else self._try(self._play.sample, now_ns)
            return self._samples(asked, now_ns)
        return super().read(now_ns)

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the read-back value of each output. Real-time safe."""
        able = self._require_open()
        if self._active and self._plays_on():
            values = None if self._stop_owed else self._try(self._play.in_force, now_ns)
            return [nan] * len(able.outputs) if values is None else values
        return super().read_back(now_ns)

    def close(self) -> None:
        """Stop a play, release control and disconnect. Never raises."""
        super().close()
        self._play.close()

    def _accepts(self, values: Sequence[float]) -> bool:
        return not self._may_play and super()._accepts(values)

    def _release_control(self) -> None:
        if self._may_play:
            self._stop()
        else:
            self._progress = Progress(PlayState.IDLE, 0)
        super()._release_control()

    def _stop(self) -> tuple[float, ...]:
        """Stop a play that may be going on; without an answer it still may be."""
        values = self._try(self._play.stop)
        if values is None:
            self._stop_owed = True
            self._fail(self.lost or self.last_fault)
            return (nan,) * len(self._require_open().outputs)
        self._may_play, self._progress = False, Progress(PlayState.IDLE, 0)
        self._written = list(values)
        return tuple(values)

    def _plays_on(self) -> bool:
        """Return whether a play may be going on; stop it, if its stop was not confirmed."""
        if self._may_play and self._stop_owed:
            self._stop()
        return self._may_play

    def _fail(self, reason: str) -> None:
        self._progress = Progress(PlayState.FAILED, self._progress.cycle, reason)

    def _require(self, state: PlayState, what: str) -> None:
        if self._progress.state is not state:
            raise DeviceError(
                f"{self._name} cannot {what}: it is {self._progress.state.value}, "
                f"it must be {state.value}"
            )

    def _require_active(self) -> None:
        if not self._active:
            raise DeviceError(f"{self._name} is not active")
        if self.lost:
            raise DeviceError(f"{self._name} is lost: {self.lost}")

    def _do(self, what: str, exchange: Callable[[*Given], AnswerT], *given: *Given) -> AnswerT:
        """Return the result of exchanges outside of the loop; a fault of the line is an error."""
        try:
            return exchange(*given)
        except LineFault as fault:
            self._note_fault(fault)
            raise DeviceError(f"{self._name} cannot {what}: {fault}") from fault


class ExchangingPlayingBusDevice(PlayingBusDevice, ExchangingBusDevice):
    """A `PlayingBusDevice` that also implements `Exchanges`.

    Args:
        name: Name in messages.
        dialogue: Exchanges of the protocol.
        play: Exchanges of a play.
    """

    def __init__(self, name: str, dialogue: ExchangingDialogue, play: PlayDialogue) -> None:
        super().__init__(name, dialogue, play)


def _limit_ns(now_ns: int, duration_ns: int) -> int:
    """Return the instant until which a cycle of a play must be complete."""
    return now_ns + duration_ns + duration_ns // 100 + OVERDUE_NS
