"""The way of one amplifier to its safe voltage, without a loop.

It knows only the driver interface, measures nothing but the voltage, and imports neither numpy nor
numba: it must work when much else does not.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from math import isfinite, nan
from typing import Final, NamedTuple

from piezod.config.daemon import StageAxisConfig
from piezod.control.guard import read_back_tolerance_v
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity, is_same
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod.units import NS_PER_S

STEP_S: Final = 0.01
"""Time between two steps."""
PATIENCE_S: Final = 2.0
"""For how long an amplifier may refuse, tell nothing, or not be where it was sent."""
NEAR_V: Final = 1.0
"""An output that is no farther outside the limits, and takes nothing there, is given the limit."""


class AxisOutcome(NamedTuple):
    """What became of an axis.

    Attributes:
        from_v: Where the ramp began, in V; NaN if that was never known.
        from_noted: Whether that is the voltage written last, as the amplifier told nothing.
        safe_v: Where it was to end, in V.
        read_back_v: What was read back in the end, in V; NaN where nothing was.
        why: Why the voltage is unknown; empty if the axis is safe.
    """

    from_v: float
    from_noted: bool
    safe_v: float
    read_back_v: float
    why: str


class AmplifierRamp:
    """Opens an amplifier, finds out where it is, ramps it down, and looks whether it got there.

    Each of that is tried until its time is over; a fault is then what `outcomes` tell.

    Args:
        channels: The amplifier, not open.
        axes: The axes that it drives.
        noted_v: The voltage written last on each, in V; NaN where that is not known.
        wait_s: For how long it may be unavailable, as that of a loop that is about to end.
        expected: Who it has to be, whatever its firmware; None: anybody.

    Attributes:
        done: Whether there is nothing left to do but to close it.
    """

    def __init__(
        self,
        channels: Channels,
        axes: Sequence[StageAxisConfig],
        noted_v: Sequence[float],
        wait_s: float,
        expected: Identity | None = None,
    ) -> None:
        self._channels, self._noted_v, self._expected = channels, noted_v, expected
        self._limits_v = [(axis.limits.drive_min_v, axis.limits.drive_max_v) for axis in axes]
        self._steps_v = [axis.safety.ramp_v_per_s * STEP_S for axis in axes]
        self._tolerances_v = [
            read_back_tolerance_v(axis.limits.drive_min_v, axis.limits.drive_max_v) for axis in axes
        ]
        self._safe_v = [axis.safe_v for axis in axes]
        self._from_v = self._drive_v = self._read_back_v = [nan] * len(axes)
        self._from_noted = self._reads_back = self.done = False
        self._why = ""
        # What is done now, for how long it may fail, and what that means.
        self._phase: Callable[[int], bool] = self._open
        self._patience_s = wait_s
        self._trouble = ""
        self._since_ns: int | None = None

    def step(self, now_ns: int) -> None:
        """Do what is next; whatever a driver raises is a reason, so that others go on."""
        if self._since_ns is None:
            self._since_ns = now_ns
        try:
            progress = self._phase(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way; the reason is told
            self._give_up(str(error) or type(error).__name__)
            return
        if progress:
            self._since_ns = None
        elif not self.done and self._failing_s(now_ns) > self._patience_s:
            self._give_up(self._trouble)

    def close(self) -> None:
        """Let go of the amplifier; to be called in any case. Never raises."""
        with suppress(Exception):  # others are still to be let go of
            self._channels.close()

    def outcomes(self) -> list[AxisOutcome]:
        """Tell what became of each axis."""
        noted = [self._from_noted] * len(self._safe_v)
        whys = [self._why] * len(self._safe_v)
        values = zip(self._from_v, noted, self._safe_v, self._read_back_v, whys, strict=True)
        return [AxisOutcome(*each) for each in values]

    def _open(self, now_ns: int) -> bool:
        try:
            self._recognise(self._channels.open())
            self._channels.activate(now_ns)
        except DeviceUnavailableError as error:
            self._channels.close()
            self._trouble = str(error)
            return False
        self._reads_back = self._channels.capabilities().read_back
        self._phase, self._patience_s = self._find_start, PATIENCE_S
        return True

    def _recognise(self, found: Identity) -> None:
        """Refuse an amplifier that nobody meant: what rests on it is not known either."""
        if self._expected is not None and not is_same(found, self._expected):
            who, wanted = (" ".join(each[:3]) for each in (found, self._expected))
            raise DeviceError(
                f"it is another device: {who}, expected: {wanted}; nothing was written; connect "
                "the right one, or start the daemon with this one"
            )

    def _find_start(self, now_ns: int) -> bool:
        told_v = list(self._channels.read_back(now_ns)) if self._reads_back else []
        silent = not told_v or not all(map(isfinite, told_v))
        if silent and self._reads_back and self._failing_s(now_ns) < PATIENCE_S / 2:
            return False
        self._from_v, self._from_noted = (list(self._noted_v), True) if silent else (told_v, False)
        if not all(map(isfinite, self._from_v)):
            self._give_up("the amplifier tells no voltage, and no last write is on record")
            return False
        self._drive_v = self._from_v
        self._phase = self._descend
        return True

    def _descend(self, now_ns: int) -> bool:
        next_v = [
            drive_v + min(max(safe_v - drive_v, -step_v), step_v)
            for drive_v, safe_v, step_v in zip(
                self._drive_v, self._safe_v, self._steps_v, strict=True
            )
        ]
        if not self._channels.write(next_v, now_ns):
            inside_v = self._just_inside(next_v)
            if inside_v == next_v or not self._channels.write(inside_v, now_ns):
                self._trouble = f"the amplifier refuses {_volts(next_v)}"
                return False
            next_v = inside_v
        self._drive_v = next_v
        if next_v == self._safe_v:
            self._phase = self._verify
        return True

    def _just_inside(self, drive_v: list[float]) -> list[float]:
        """Return the limits instead of what is a little beyond them."""
        inside_v = [
            min(max(each_v, low_v), high_v)
            for each_v, (low_v, high_v) in zip(drive_v, self._limits_v, strict=True)
        ]
        near = all(abs(a - b) <= NEAR_V for a, b in zip(inside_v, drive_v, strict=True))
        return inside_v if near else drive_v

    def _verify(self, now_ns: int) -> bool:
        if self._reads_back:
            self._read_back_v = list(self._channels.read_back(now_ns))
        self.done = not self._reads_back or all(
            abs(told_v - safe_v) <= tolerance_v
            for told_v, safe_v, tolerance_v in zip(
                self._read_back_v, self._safe_v, self._tolerances_v, strict=True
            )
        )
        self._trouble = (
            f"the amplifier was sent to {_volts(self._safe_v)} and tells "
            f"{_volts(self._read_back_v)}"
        )
        return self.done

    def _failing_s(self, now_ns: int) -> float:
        return 0.0 if self._since_ns is None else (now_ns - self._since_ns) / NS_PER_S

    def _give_up(self, why: str) -> None:
        self._why, self.done = why, True


def _volts(values_v: Sequence[float]) -> str:
    return ", ".join(f"{value_v:.2f} V" for value_v in values_v)
