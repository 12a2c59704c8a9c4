"""Ramps one amplifier to its safe voltage, without a loop.

It knows only the driver interface, measures only the voltage, and imports neither numpy nor numba:
it must work when much else does not.
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
MAX_FAILING_S: Final = 2.0
"""How long an amplifier may refuse, report nothing, or not reach its voltage, in s."""
NEAR_V: Final = 1.0
"""An output that is outside the limits by no more than this, and refuses the next step, is set to
the limit."""


class AxisOutcome(NamedTuple):
    """The result for an axis.

    Attributes:
        from_v: Voltage at which the ramp began, in V; NaN if it was never known.
        from_noted: Whether that is the last written voltage, because the amplifier reported none.
        safe_v: Voltage at which the ramp should end, in V.
        read_back_v: Read-back voltage at the end, in V; NaN if there is none.
        why: Why the voltage is unknown; empty if the axis is safe.
    """

    from_v: float
    from_noted: bool
    safe_v: float
    read_back_v: float
    why: str


class AmplifierRamp:
    """Opens an amplifier, finds its voltage, ramps it down, and verifies the result.

    Each phase is tried until its time is over; then `outcomes` has the reason.

    Args:
        channels: The amplifier, not open.
        axes: The axes that it drives.
        last_v: Last written voltage of each axis, in V; NaN if it is not known.
        wait_s: How long it may be unavailable, in s, as while another process closes it.
        expected: Identity that it must have, apart from its firmware; None accepts any.

    Attributes:
        done: Whether it only has to be closed.
    """

    def __init__(
        self,
        channels: Channels,
        axes: Sequence[StageAxisConfig],
        last_v: Sequence[float],
        wait_s: float,
        expected: Identity | None = None,
    ) -> None:
        self._channels, self._last_v, self._expected = channels, last_v, expected
        self._limits_v = [(axis.limits.drive_min_v, axis.limits.drive_max_v) for axis in axes]
        self._steps_v = [axis.safety.ramp_v_per_s * STEP_S for axis in axes]
        self._tolerances_v = [
            read_back_tolerance_v(axis.limits.drive_min_v, axis.limits.drive_max_v) for axis in axes
        ]
        self._safe_v = [axis.safe_v for axis in axes]
        self._from_v = self._drive_v = self._read_back_v = [nan] * len(axes)
        self._from_noted = self._reads_back = self.done = False
        self._why = ""
        # The present phase, how long it may fail, why it fails, and since when.
        self._phase: Callable[[int], bool] = self._open
        self._max_failing_s = wait_s
        self._trouble = ""
        self._since_ns: int | None = None

    def step(self, now_ns: int) -> None:
        """Do the next step of the present phase; an exception of a driver ends this ramp only."""
        if self._since_ns is None:
            self._since_ns = now_ns
        try:
            progress = self._phase(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way: an outcome
            self._give_up(str(error) or type(error).__name__)
            return
        if progress:  # each step may fail for the full time
            self._since_ns = None
        elif not self.done and self._failing_s(now_ns) > self._max_failing_s:
            self._give_up(self._trouble)

    def close(self) -> None:
        """Close the amplifier; call it in any case. Never raises."""
        with suppress(Exception):  # the other amplifiers must be closed too
            self._channels.close()

    def outcomes(self) -> list[AxisOutcome]:
        """Return the outcome of each axis."""
        from_noted = [self._from_noted] * len(self._safe_v)
        whys = [self._why] * len(self._safe_v)
        values = zip(self._from_v, from_noted, self._safe_v, self._read_back_v, whys, strict=True)
        return [AxisOutcome(*each) for each in values]

    def _open(self, now_ns: int) -> bool:
        try:
            self._check_identity(self._channels.open())
            self._channels.activate(now_ns)
        except DeviceUnavailableError as error:  # a loop that ends may still hold it: try again
            self._channels.close()
            self._trouble = str(error)
            return False
        self._reads_back = self._channels.capabilities().read_back
        self._phase, self._max_failing_s = self._find_start, MAX_FAILING_S
        return True

    def _check_identity(self, found: Identity) -> None:
        """Refuse another amplifier, on which something unknown may rest."""
        if self._expected is not None and not is_same(found, self._expected):
            present, wanted = (" ".join(each[:3]) for each in (found, self._expected))
            raise DeviceError(
                f"it is another device: {present}, expected: {wanted}; nothing was written; "
                "connect the right one, or start the daemon with this one"
            )

    def _find_start(self, now_ns: int) -> bool:
        read_back_v = list(self._channels.read_back(now_ns)) if self._reads_back else []
        unknown = not read_back_v or not all(map(isfinite, read_back_v))
        # Use the last write after half of the time; after all of it `step` gives up.
        if unknown and self._reads_back and self._failing_s(now_ns) < MAX_FAILING_S / 2:
            return False
        self._from_v = list(self._last_v) if unknown else read_back_v
        self._from_noted = unknown
        if not all(map(isfinite, self._from_v)):
            self._give_up("the amplifier reports no voltage, and no last write is stored")
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
            # An amplifier may rest just outside its limits and refuse any value there.
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
        """Return the limits for values that are a little beyond them; other values unchanged."""
        inside_v = [
            min(max(each_v, low_v), high_v)
            for each_v, (low_v, high_v) in zip(drive_v, self._limits_v, strict=True)
        ]
        near = all(abs(a - b) <= NEAR_V for a, b in zip(inside_v, drive_v, strict=True))
        return inside_v if near else drive_v

    def _verify(self, now_ns: int) -> bool:
        if self._reads_back:
            self._read_back_v = list(self._channels.read_back(now_ns))
        # Without a read-back, the last accepted write has to be enough.
        self.done = not self._reads_back or all(
            abs(read_back_v - safe_v) <= tolerance_v
            for read_back_v, safe_v, tolerance_v in zip(
                self._read_back_v, self._safe_v, self._tolerances_v, strict=True
            )
        )
        self._trouble = (
            f"the amplifier was set to {_volts(self._safe_v)} and reads back "
            f"{_volts(self._read_back_v)}"
        )
        return self.done

    def _failing_s(self, now_ns: int) -> float:
        return 0.0 if self._since_ns is None else (now_ns - self._since_ns) / NS_PER_S

    def _give_up(self, why: str) -> None:
        self._why, self.done = why, True


def _volts(values_v: Sequence[float]) -> str:
    return ", ".join(f"{value_v:.2f} V" for value_v in values_v)
