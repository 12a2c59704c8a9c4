"""The voltage in force on an axis: what says so, and how sure that is. Pure, without numpy.

The only judge of this question. Everything that starts from a voltage asks it: arming, a ramp, the
takeover of an amplifier that was lost or that another process has left, the end of a play,
`piezod safe`.

Four witnesses may speak: the read-back, the own last write, the sensor, and the flags of the
amplifier. Two voltages are credible: the read-back, and the last write. They usually agree. If they
do not, the amplifier's own report decides, then the sensor, if it contradicts one of them only. If
nothing decides, the voltage is unknown: nobody may write, and a person has to look.
"""

from enum import Enum, auto
from math import isfinite, nan
from typing import Final, NamedTuple

STAYED: Final = 0.25
MOVED: Final = 0.33
"""The sensor contradicts the read-back if it has seen less than this share of the way from the last
write to the read-back, and the last write if it has seen more than that share. The slopes of a
hysteresis lie between, as the errors of a model do."""


OUTPUT_WAIT_S: Final = 30.0
"""How long a ramp to the safe voltage waits for an output that does not follow its writes, in s;
then the ramp has failed, and the voltage stays. The ramp of the loop and that of `piezod safe`,
which follows it, together end well within the 90 s after which systemd kills a service."""


class Claim(NamedTuple):
    """A voltage that may be in force."""

    drive_v: float  #: The voltage, in V; NaN if there is none.
    #: Lowest position that a stage can have at this voltage, in µm; NaN without a model, or if the
    #: sensor was never zeroed.
    low_um: float = nan
    high_um: float = nan  #: Highest such position, in µm.

    def excludes(self, position_um: float) -> bool:
        """Return whether the stage cannot be at a position; False if either is unknown."""
        return position_um < self.low_um or position_um > self.high_um

    def __str__(self) -> str:
        """Return the voltage and its positions, for people."""
        if not isfinite(self.drive_v):
            return "unknown"
        positions = f" (allows {self.low_um:.4g} to {self.high_um:.4g} µm)"
        return f"{self.drive_v:z.4g} V{positions if isfinite(self.low_um) else ''}"


class Evidence(NamedTuple):
    """Everything that is known about the voltage in force on an axis."""

    read_back: Claim  #: The read-back.
    #: The voltage that the amplifier acknowledged last; none if something else may have changed the
    #: output since.
    written: Claim
    position_um: float = nan  #: Measured position, in µm; NaN if it proves nothing.
    #: Share of the way from the last write to the read-back that the sensor has seen since the two
    #: agreed: 0 if the output is at the last write, 1 if it is at the read-back; NaN if that is
    #: unknown.
    moved: float = nan
    #: Whether the amplifier has reported since the last acknowledged write that its output fell, or
    #: that a person sets it.
    reports_move: bool = False
    #: Whether the output can have come to the read-back by itself: by a player, or as `left_alone`
    #: tells.
    explained: bool = False


_NONE: Final = Claim(nan)
_UNDECIDED: Final = "nothing tells which of them is right"


class Source(Enum):
    """What tells the voltage in force."""

    AGREED = auto()
    """Read-back and last write, or the only one of them that there is."""
    READ_BACK = auto()
    """The read-back, against the last write."""
    WRITTEN = auto()
    """The last write: the read-back is false."""
    UNKNOWN = auto()
    """Nothing decides between read-back and last write."""


class InForce(NamedTuple):
    """The voltage in force on an axis."""

    drive_v: float  #: The voltage, in V; NaN if it is unknown.
    source: Source  #: What tells it.
    #: The values that do not agree, and what follows, for people; empty if they agree.
    doubt: str = ""
    #: Whether the stage may be armed there: nothing contradicts it, or more than one witness stands
    #: against the one that does.
    proven: bool = True


def voltage_in_force(known: Evidence, tolerance_v: float) -> InForce:
    """Return the voltage in force on an axis. Real-time safe.

    Args:
        known: The evidence.
        tolerance_v: Allowed difference between read-back and written voltage, in V.
    """
    read_back, written = known.read_back, known.written
    if abs(read_back.drive_v - written.drive_v) > tolerance_v:
        source, why, proven = _of_two(known)
        chosen = {Source.READ_BACK: read_back, Source.WRITTEN: written}.get(source, _NONE)
        return InForce(chosen.drive_v, source, _doubt(known, why), proven)
    only = read_back if isfinite(read_back.drive_v) else written
    source = Source.AGREED if isfinite(only.drive_v) else Source.UNKNOWN
    if only.excludes(known.position_um):
        if not (isfinite(read_back.drive_v) and isfinite(written.drive_v)):
            # One witness against another.
            return InForce(nan, Source.UNKNOWN, _doubt(known, _UNDECIDED), proven=False)
        why = "there is no other voltage to start from"
        return InForce(only.drive_v, source, _doubt(known, why), proven=False)
    return InForce(only.drive_v, source)


def left_alone(
    read_back_v: float, written_v: float, rest_v: float, tolerance_v: float, *, watchdog: bool
) -> bool:
    """Return whether an output to which nothing could be written has come to its read-back so.

    A loss of power leaves it at 0 V or at rest. A watchdog of the device brings it towards rest.

    Args:
        read_back_v: The read-back, in V.
        written_v: The last write, in V; NaN if there is none.
        rest_v: The rest voltage, in V.
        tolerance_v: Allowed difference between read-back and output, in V.
        watchdog: Whether the device has one.
    """
    unpowered = min(abs(read_back_v), abs(read_back_v - rest_v)) <= tolerance_v
    return unpowered or fell(read_back_v, written_v, rest_v if watchdog else nan)


def fell(read_back_v: float, written_v: float, rest_v: float) -> bool:
    """Return whether a device's own watchdog explains a read-back: it is nearer to rest.

    Args:
        read_back_v: The read-back, in V.
        written_v: The last write, in V.
        rest_v: Voltage to which the watchdog brings the output, in V; NaN without a watchdog.
    """
    return abs(read_back_v - rest_v) < abs(written_v - rest_v)


def _of_two(known: Evidence) -> tuple[Source, str, bool]:
    """Return which of two voltages is in force, why, and whether that is proven."""
    read_back, written, position_um, moved, reports_move, explained = known
    if reports_move:
        why = "the read-back counts, because the amplifier reports that its output has changed"
        return Source.READ_BACK, why, not read_back.excludes(position_um)
    read_back_false = read_back.excludes(position_um) or moved < STAYED
    written_false = written.excludes(position_um) or moved > MOVED
    if read_back_false and not written_false:
        return Source.WRITTEN, f"the sensor allows {written.drive_v:.4g} V only", False
    if written_false and not read_back_false:
        return Source.READ_BACK, f"the sensor allows {read_back.drive_v:.4g} V only", True
    if explained:
        # A step up from an output that has lost its power would be the worst that can happen.
        why = "the read-back counts, because the output may have come there by itself"
        return Source.READ_BACK, why, False
    return Source.UNKNOWN, _UNDECIDED, False


def _doubt(known: Evidence, why: str) -> str:
    """Return the three numbers and what follows from them, for people."""
    written = f", last write {known.written}" if isfinite(known.written.drive_v) else ""
    sensor = "no sensor to ask"
    if isfinite(known.position_um):
        sensor = f"sensor {known.position_um:.4g} µm"
    return f"read-back {known.read_back}{written} and {sensor} do not agree: {why}"
