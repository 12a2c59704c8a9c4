"""The interface of a device that plays a table of values by its own clock.

A bus carries 30 to 1000 setpoints a second. A player takes a whole table beforehand, plays it with
its own clock, and records the sensor beside it. A device that plays implements `Player` beside the
interfaces in `piezod.devices.interface`. A play goes through these steps, in this order::

    load ──► arm ──► start ──► progress … ──► recording
                                └──► abort (at any time after `load`, any number of times)

- From `start` until the play has ended or was aborted, the device refuses `write`.
- A table begins with its lead-in, which is played once. Then its period is played `cycles` times.
  The number of cycles is finite: the device plays on when its host dies.
- `abort` never jumps: the outputs keep the value at which the play stops. A ramp to a safe voltage
  follows by ordinary writes.
- Only `progress` and `abort` are called in the loop. `load`, `arm`, `start`, `replace` and
  `recording` may take seconds, and are called outside of it. `load` and `recording` end between two
  exchanges if their `check` raises, so that a stop does not wait for the rest of a table.
- A play that waits for edges goes on at a rising edge of the device's trigger input, by itself. It
  counts the edges that come while points are played, which move nothing.
- The device checks a table against its own range. The limits of an axis are checked before, for the
  table as a whole.
"""

from __future__ import annotations

import typing
from collections.abc import Callable
from enum import Enum
from typing import NamedTuple, Protocol, TypeAlias, runtime_checkable

if typing.TYPE_CHECKING:  # `piezod safe` stops a play without numpy
    import numpy as np
    import numpy.typing as npt

    FloatArray: TypeAlias = npt.NDArray[np.float64]
    Mask: TypeAlias = npt.NDArray[np.uint8]

Check: TypeAlias = Callable[[], None]
"""Called between two exchanges with a device; raises `PlayCancelledError` to end there."""


def go_on() -> None:
    """Cancel nothing: the `Check` of a caller that waits for the end."""


class AtEnd(Enum):
    """What the outputs do when a play ends by itself."""

    HOLDS = "holds"
    """They keep the last value of the table."""
    RESTS = "rests"
    """They go to rest."""
    UNKNOWN = "unknown"
    """No source says."""


class PlayerCapabilities(NamedTuple):
    """Capabilities of the player of an open device."""

    shortest_interval_ns: int  #: Shortest time between two points, in ns.
    interval_step_ns: int  #: Intervals are the shortest one plus multiples of this, in ns.
    longest_interval_ns: int  #: Longest time between two points, in ns.
    #: Largest number of points of a table, lead-in and period together, for each output.
    points: int
    points_shared: bool  #: Whether all outputs together have that number.
    resolution: tuple[float, ...]  #: Smallest step of each output, in its unit.
    cycles: int  #: Largest number of cycles; 0 if only the host can end a play.
    replaces: bool  #: Whether a table can be replaced while it is played.
    record_points: int  #: Largest number of recorded samples of each input.
    records_with_play: bool  #: Whether the record begins with the first point of the table.
    lag_ns: int = 0  #: Time from a point of the table to its output, relative to the record, in ns.
    at_end: AtEnd = AtEnd.UNKNOWN  #: What the outputs do at the end.
    watchdog_while_playing: bool = False  #: Whether the device's own watchdog works while it plays.
    record_shared: bool = False  #: Whether the record has the memory that a table leaves.
    pulse_lines: int = 0  #: Number of digital outputs that can be set in step with the points.
    edge_waits: int = 0  #: Most waits for an edge in a play; 1 if an edge can only start it.
    #: How it pulses at positions: "time" if its pulses need not be even, "device" if it compares.
    pulses_at: tuple[str, ...] = ()

    def legal_interval_ns(self, interval_ns: int) -> int:
        """Return the shortest legal interval that is not shorter than the given one, in ns."""
        wanted = max(interval_ns - self.shortest_interval_ns, 0)
        steps = -(-wanted // self.interval_step_ns)
        return min(
            self.shortest_interval_ns + steps * self.interval_step_ns, self.longest_interval_ns
        )


class EdgeWaits(NamedTuple):
    """Points before which a play holds its outputs until an edge comes."""

    first: int  #: Point of the period before which it waits.
    every: int  #: Points from there to each further wait, at least 1.
    times: int  #: Number of waits, at least 1.
    #: Longest wait, in ns. The play ends there without an edge: its record has the points before.
    within_ns: int

    @property
    def places(self) -> range:
        """The points before which it waits."""
        return range(self.first, self.first + self.times * self.every, self.every)

    @property
    def longest_ns(self) -> int:
        """Longest time that all waits take, in ns."""
        return self.times * self.within_ns


class SeenEdge(NamedTuple):
    """A rising edge at the trigger input of a device that plays."""

    t_ns: int  #: Time since the start of the play, by the device's clock, in ns.
    used: bool  #: Whether the play waited for it; otherwise points were played.


class Comparison(NamedTuple):
    """Readings at which the device itself pulses, while they go from the first to the last."""

    line: int  #: Line of pulses, from 1; the pulses of the table leave it low.
    input: int  #: Index of the input.
    first: float  #: First reading, in the unit of the input.
    last: float  #: No pulse comes behind it.
    step: float  #: Distance between two pulses; negative on the way down.


class Table(NamedTuple):
    """Values to play."""

    interval_ns: int  #: Time between two points, in ns.
    lead_in: FloatArray  #: (m, outputs) values that are played once, before the period; m may be 0.
    period: FloatArray  #: (n, outputs) values of one period, in the unit of each output.
    cycles: int  #: Number of periods, at least 1.
    #: (n,) digital outputs at the points of the period, a bit for each line, the lowest for line 1;
    #: they are low in the lead-in and at the end. None leaves them alone.
    pulses: Mask | None = None
    #: Where it waits for edges; it has one cycle and no lead-in then. None for nowhere.
    edges: EdgeWaits | None = None
    compared: Comparison | None = None  #: Pulses by its own comparison; None for none.

    @property
    def longest_wait_ns(self) -> int:
        """Longest time for which it waits for edges, in ns."""
        return 0 if self.edges is None else self.edges.longest_ns

    @property
    def n_points(self) -> int:
        """Number of points of the whole play."""
        return len(self.lead_in) + len(self.period) * self.cycles

    @property
    def duration_ns(self) -> int:
        """Duration of the whole play, in ns."""
        return self.n_points * self.interval_ns


class PlayState(Enum):
    """State of a play."""

    IDLE = "idle"
    """Nothing is loaded, or the last play has been read or aborted."""
    LOADED = "loaded"
    ARMED = "armed"
    PLAYING = "playing"
    ENDED = "ended"
    """The play has ended by itself; the record is ready."""
    FAILED = "failed"
    """The device reports an error, or its answers do not fit the play."""


class Progress(NamedTuple):
    """Progress of a play."""

    state: PlayState  #: Present state.
    cycle: int  #: Complete cycles so far.
    reason: str = ""  #: What failed; empty if nothing did.


class PlayedRecord(NamedTuple):
    """What the device recorded during a play."""

    interval_ns: int  #: Time between two samples, in ns.
    #: (k, inputs) samples, in the unit of each input; NaN if a sample was lost or is not valid.
    positions: FloatArray
    #: Index of the point of lead-in and period at which the first sample was taken.
    first_point: int
    #: (k, outputs) outputs that the device measured beside; of shape (k, 0) if it does not measure
    #: them.
    outputs: FloatArray
    edges: tuple[SeenEdge, ...] = ()  #: The edges of a play that waits for them.


@runtime_checkable
class Player(Protocol):
    """A device that plays tables; see the docstring of this module for the order of the calls.

    All methods raise `DeviceError` if the device is not open and active, and `load`, `arm`, `start`
    and `replace` if they are called out of order or the device refuses.
    """

    def player_capabilities(self) -> PlayerCapabilities:
        """Return the capabilities; they stay the same until the device is closed."""
        ...

    def load(self, table: Table, check: Check = go_on) -> Table:
        """Load a table; return it as the device will play it, with its own resolution.

        It is read back and compared if the device can do that. The outputs do not change.

        Raises:
            DeviceError: If the table does not fit the capabilities or the range of an output; the
                text names value and allowed range. Nothing is loaded then.
            PlayCancelledError: If `check` has raised it. Nothing is loaded then.
        """
        ...

    def arm(self) -> None:
        """Prepare the start: everything but the start itself. The outputs do not change."""
        ...

    def start(self, now_ns: int) -> None:
        """Start the play and the record."""
        ...

    def replace(self, period: FloatArray) -> FloatArray:
        """Replace the period at the end of the cycle in play; return it as it will be played.

        Raises:
            DeviceError: If `PlayerCapabilities.replaces` is False.
        """
        ...

    def progress(self, now_ns: int) -> Progress:
        """Return the progress. Call once per cycle. Real-time safe."""
        ...

    def abort(self, now_ns: int) -> tuple[float, ...]:
        """Stop the play; return the value in force of each output, NaN if it is unknown.

        Does nothing if nothing is played. Never raises. Real-time safe.
        """
        ...

    def recording(self, check: Check = go_on) -> PlayedRecord:
        """Return the record of the play that has ended.

        Raises:
            DeviceError: If none has ended, or the record could not be read.
            PlayCancelledError: If `check` has raised it. The record can be read again.
        """
        ...


@runtime_checkable
class CountsPulses(Protocol):
    """A simulated player that counts its pulses."""

    def pulses_counted(self) -> tuple[int, ...]:
        """Return the number of rising edges of each line since the device was opened."""
        ...


@runtime_checkable
class KnowsTruePlay(Protocol):
    """A simulated player that knows the true displacement during a play."""

    def true_recording(self) -> FloatArray:
        """Return the true displacements at the samples of `recording`, in µm, shape (k, inputs).

        They are those of the mechanics from rest, before the sensor, as in `KnowsTruth`.

        Raises:
            DeviceError: If no play has ended.
        """
        ...
