"""Ramps one amplifier to its safe voltage, without a loop.

It knows only the driver interface, measures only the voltage, and imports neither numpy nor numba:
it must work when much else does not. Where read-back and last write contradict each other, nothing
is written, and a person has to decide. An output that does not follow is waited for, 30 s in all.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from math import isfinite, nan
from typing import Final, NamedTuple

from piezod.config.daemon import StageAxisConfig
from piezod.control.guard import read_back_tolerance_v
from piezod.control.in_force import (
    OUTPUT_WAIT_S,
    Claim,
    Evidence,
    InForce,
    Source,
    fell,
    voltage_in_force,
)
from piezod.daemon.output_notes import outdated, rests_by_itself
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity, is_same
from piezod.devices.status import MOVED
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod.units import NS_PER_S

STEP_S: Final = 0.01
"""Time between two steps."""
MAX_FAILING_S: Final = 2.0
"""How long an amplifier may refuse, report nothing, or not reach its voltage, in s."""
LAG_STEPS: Final = 10
"""An output may be this many steps behind before the ramp waits for it."""
NEAR_V: Final = 1.0
"""An output that is outside the limits by no more than this, and refuses the next step, is set to
the limit."""
SAME_PART: Final = 0.05
"""However fast a loop may be, read-back and last write are not the same voltage if they are farther
apart than this share of the range and the tolerance."""
CONFIRM: Final = "if the read-back is right, `piezod safe --confirm-output` starts there"


class AxisOutcome(NamedTuple):
    """The result for an axis."""

    from_v: float  #: Voltage at which the ramp began, in V; NaN if it was never known.
    #: Whether that is the last written voltage, because the amplifier reported none.
    from_noted: bool
    safe_v: float  #: Voltage at which the ramp should end, in V.
    read_back_v: float  #: Read-back voltage at the end, in V; NaN if there is none.
    why: str  #: Why the voltage is unknown; empty if the axis is safe.
    #: Voltage that was written last, by this ramp or before it, in V; NaN if that is not known, or
    #: if the amplifier goes to rest from there when it is closed.
    written_v: float = nan


class Before(NamedTuple):
    """What is known of the process that drove an amplifier before."""

    last_v: Sequence[float]  #: Last written voltage of each axis, in V; NaN if it is not known.
    #: Identity that the amplifier must have, apart from its firmware; None accepts any.
    expected: Identity | None
    rate_hz: float  #: Rate of the loop, in Hz.
    clean: bool  #: Whether it has ended in order, and so has closed the amplifier.
    #: Whether a person answers for the read-back, whatever was written last; without a read-back,
    #: that the output is at the safe voltage.
    confirmed: bool


class AmplifierRamp:
    """Opens an amplifier, finds its voltage, ramps it down, and verifies the result.

    Each phase is tried until its time is over; then `outcomes` has the reason. All waits for the
    open amplifier together last `OUTPUT_WAIT_S` at most.

    Args:
        channels: The amplifier, not open.
        axes: The axes that it drives.
        before: What is known of the process that wrote last.
        wait_s: How long it may be unavailable, in s, as while another process closes it.

    Attributes:
        done: Whether it only has to be closed.
    """

    def __init__(
        self,
        channels: Channels,
        axes: Sequence[StageAxisConfig],
        before: Before,
        wait_s: float,
    ) -> None:
        self._channels, self._before, self._last_v = channels, before, before.last_v
        self._slews_v_per_s = [axis.limits.slew_v_per_s for axis in axes]
        self._limits_v = [(axis.limits.drive_min_v, axis.limits.drive_max_v) for axis in axes]
        self._steps_v = [axis.safety.ramp_v_per_s * STEP_S for axis in axes]
        self._tolerances_v = [
            read_back_tolerance_v(axis.limits.drive_min_v, axis.limits.drive_max_v) for axis in axes
        ]
        self._safe_v = [axis.safe_v for axis in axes]
        self._rest_v = [axis.limits.rest_v for axis in axes]
        # By how far the last write may be ahead of the output, which it is noted before.
        self._ahead_v = [0.0] * len(axes)
        self._from_v = self._drive_v = self._read_back_v = [nan] * len(axes)
        # The last finite read-back of each axis, and how many steps ago it was.
        self._shown_v, self._silent_steps = [nan] * len(axes), 0
        self._from_noted = self._reads_back = self._wrote = self.done = False
        self._why, self._rests = "", False
        # The present phase, how long it may fail, why it fails, and since when.
        self._phase: Callable[[int], bool] = self._open
        self._max_failing_s = wait_s
        self._trouble = ""
        self._since_ns: int | None = None
        self._waited_s = 0.0  # in the phases before, for the open amplifier

    def step(self, now_ns: int) -> None:
        """Do the next step of the present phase; an exception of a driver ends this ramp only."""
        if self._since_ns is None:
            self._since_ns = now_ns
        opening = self._phase == self._open
        try:
            progress = self._phase(now_ns)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way: an outcome
            self._give_up(str(error) or type(error).__name__)
            return
        if progress:  # each step may fail for the full time, as long as all of them have time
            self._waited_s += 0.0 if opening else self._failing_s(now_ns)
            self._since_ns = None
        elif not self.done and self._failing_s(now_ns) > self._left_s():
            self._give_up(self._trouble)

    def _left_s(self) -> float:
        """Return how long the present phase may fail, in s."""
        if self._phase == self._open:
            return self._max_failing_s
        return min(self._max_failing_s, OUTPUT_WAIT_S - self._waited_s)

    def close(self) -> None:
        """Close the amplifier; call it in any case. Never raises."""
        with suppress(Exception):  # the other amplifiers must be closed too
            self._channels.close()

    def outcomes(self) -> list[AxisOutcome]:
        """Return the outcome of each axis."""
        from_noted = [self._from_noted] * len(self._safe_v)
        whys = [self._why] * len(self._safe_v)
        written_v = list(self._drive_v if self._wrote else self._last_v)
        if self.done and not self._why and self._rests:
            written_v = [
                drive_v if self._at_rest(axis, drive_v) else nan
                for axis, drive_v in enumerate(written_v)
            ]
        values = zip(
            self._from_v,
            from_noted,
            self._safe_v,
            self._read_back_v,
            whys,
            written_v,
            strict=True,
        )
        return [AxisOutcome(*each) for each in values]

    def _open(self, now_ns: int) -> bool:
        try:
            self._check_identity(self._channels.open())
            self._channels.activate(now_ns)
        except DeviceUnavailableError as error:  # a loop that ends may still hold it: try again
            self._channels.close()
            self._trouble = str(error)
            return False
        able = self._channels.capabilities()
        self._reads_back, self._rests = able.read_back, rests_by_itself(able)
        if outdated(able, clean=self._before.clean):
            # Without a read-back only a last write at rest still says where the output is.
            self._last_v = [
                drive_v if not self._reads_back and self._at_rest(axis, drive_v) else nan
                for axis, drive_v in enumerate(self._last_v)
            ]
        cycle_s = 1.0 / min(self._before.rate_hz, able.max_rate_hz)
        self._ahead_v = [
            min(slew_v_per_s * cycle_s, SAME_PART * (high_v - low_v))
            for slew_v_per_s, (low_v, high_v) in zip(
                self._slews_v_per_s, self._limits_v, strict=True
            )
        ]
        self._phase, self._max_failing_s = self._find_start, MAX_FAILING_S
        return True

    def _at_rest(self, axis: int, drive_v: float) -> bool:
        """Return whether a voltage is the one to which the amplifier goes by itself."""
        return abs(drive_v - self._rest_v[axis]) <= self._tolerances_v[axis]

    def _check_identity(self, found: Identity) -> None:
        """Refuse another amplifier, on which something unknown may rest."""
        expected = self._before.expected
        if expected is not None and not is_same(found, expected):
            present, wanted = (" ".join(each[:3]) for each in (found, expected))
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
        spoken_for = self._before.confirmed and not self._reads_back
        start_v = self._safe_v if spoken_for else list(self._last_v)
        if not unknown:
            found = self._in_force(read_back_v, now_ns)
            start_v = [each.drive_v for each in found]
            if doubt := "; ".join(each.doubt for each in found if not isfinite(each.drive_v)):
                self._read_back_v = read_back_v
                self._give_up(f"{doubt}; {CONFIRM}")
                return False
        self._from_v, self._from_noted = start_v if unknown else read_back_v, unknown
        if not all(map(isfinite, start_v)):
            self._give_up("the amplifier reports no voltage, and no last write is stored")
            return False
        self._drive_v = start_v
        self._phase = self._descend
        return True

    def _in_force(self, read_back_v: Sequence[float], now_ns: int) -> list[InForce]:
        """Return the voltage in force on each axis.

        The stored voltage may be ahead of the output, because it is stored before it is written.
        Where it is ahead by no more than a step of the loop, the start is half-way.
        """
        flags = self._channels.status(now_ns)[len(read_back_v) :]
        able = self._channels.capabilities()
        found = list[InForce]()
        for i, (drive_v, rest_v) in enumerate(zip(read_back_v, self._rest_v, strict=True)):
            last_v = nan if self._before.confirmed else self._last_v[i]
            known = Evidence(
                Claim(drive_v),
                Claim(last_v),
                reports_move=not MOVED.isdisjoint(flags[i]),
                # A watchdog brings the output towards rest when nobody writes any more.
                explained=fell(drive_v, last_v, rest_v if able.watchdog else nan),
            )
            one = voltage_in_force(known, self._tolerances_v[i] + self._ahead_v[i])
            if one.source is Source.AGREED and isfinite(last_v):
                one = one._replace(drive_v=(drive_v + last_v) / 2.0)
            found.append(one)
        return found

    def _descend(self, now_ns: int) -> bool:
        if self._reads_back:
            self._read_back_v = list(self._channels.read_back(now_ns))
            complete = all(map(isfinite, self._read_back_v))
            self._silent_steps = 0 if complete else self._silent_steps + 1
            self._shown_v = [
                new if isfinite(new) else old
                for new, old in zip(self._read_back_v, self._shown_v, strict=True)
            ]
        next_v = [self._next_v(axis) for axis in range(len(self._drive_v))]
        # A write sets every axis again, so one that is out of reach holds back the others.
        lost = any(self._behind(axis, drive_v) for axis, drive_v in enumerate(self._drive_v))
        if lost or (self._wrote and next_v == self._drive_v != self._safe_v):
            self._max_failing_s = OUTPUT_WAIT_S
            what = "the output does not follow its writes"
            if not self._wrote:
                what = "nothing was written, because the output is not where the ramp begins"
            self._trouble = f"the voltage stays: {what}, {self._written()}; {CONFIRM}"
            return False
        self._max_failing_s = MAX_FAILING_S
        if not self._channels.write(next_v, now_ns):
            # An amplifier may rest just outside its limits and refuse any value there.
            inside_v = self._just_inside(next_v)
            if inside_v == next_v or not self._channels.write(inside_v, now_ns):
                self._trouble = f"the amplifier refuses {_volts(next_v)}"
                return False
            next_v = inside_v
        self._drive_v, self._wrote = next_v, True
        if next_v == self._safe_v:
            self._phase = self._verify
        return True

    def _next_v(self, axis: int) -> float:
        """Return the next voltage of an axis; the present one while its output is behind.

        A start that is not at the read-back is written first: it is near the last write, too.
        """
        drive_v, step_v = self._drive_v[axis], self._steps_v[axis]
        if not self._wrote and abs(drive_v - self._shown_v[axis]) > self._tolerances_v[axis] / 2.0:
            return drive_v
        next_v = drive_v + min(max(self._safe_v[axis] - drive_v, -step_v), step_v)
        return drive_v if self._behind(axis, next_v) else next_v

    def _behind(self, axis: int, drive_v: float) -> bool:
        """Return whether a voltage is out of reach of the output."""
        step_v = self._steps_v[axis]
        lag_v = min(LAG_STEPS * step_v, self._slews_v_per_s[axis] * STEP_S)
        reach_v = max(lag_v, self._ahead_v[axis]) + self._tolerances_v[axis]
        reach_v += self._silent_steps * step_v
        # NaN compares false: without a read-back the own writes have to be enough.
        return abs(drive_v - self._shown_v[axis]) > reach_v

    def _written(self) -> str:
        """Return the voltages that were written and those that are read back, for people."""
        how = "written" if self._wrote else "to begin with"
        return f"{_volts(self._drive_v)} {how}, {_volts(self._read_back_v)} read back"

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
        self._trouble = f"the amplifier does not show the safe voltage: {self._written()}"
        return self.done

    def _failing_s(self, now_ns: int) -> float:
        return 0.0 if self._since_ns is None else (now_ns - self._since_ns) / NS_PER_S

    def _give_up(self, why: str) -> None:
        self._why, self.done = why, True


def _volts(values_v: Sequence[float]) -> str:
    return ", ".join(f"{value_v:z.2f} V" for value_v in values_v)
