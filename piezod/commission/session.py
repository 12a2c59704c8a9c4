"""One axis, driven by hand: slowly, within its limits, and back to where it was found."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Final

import numpy as np

from piezod.control.guard import Guard, Limits
from piezod.control.signals import RecentRange
from piezod.daemon.clock import Clock
from piezod.daemon.loop.pacer import Pacer
from piezod.devices.channels import Channels
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S, s_to_ns

PATIENCE_S: Final = 2.0
"""Writes that are refused for so long end a step; a lost reply is over by then."""
HOLD_S: Final = 0.1
"""Who waits is asked so often whether that is over."""
OFF_CYCLES: Final = 50
"""A voltage read back that is none of those written lately, for so long, ends a step."""
LAG_CYCLES, LAG_S = 3, 0.1
"""Lately: an amplifier may follow, and tell so, later by so many cycles and this time."""
SETTLE_CYCLES, SETTLE_S = 4, 0.05
"""A ramp lasts longer by so many cycles, or this time: its last write is that of its end."""
ENDING: Final = frozenset(
    {
        DeviceFlag.OVERLOAD,
        DeviceFlag.OVER_TEMPERATURE,
        DeviceFlag.SHORT_OR_OPEN,
        DeviceFlag.LOCAL_MODE,
        DeviceFlag.RESTARTED,
        DeviceFlag.WATCHDOG_TRIPPED,
    }
)
"""What a device says that ends a step."""
ELSEWHERE: Final = frozenset(
    {DeviceFlag.LOCAL_MODE, DeviceFlag.RESTARTED, DeviceFlag.WATCHDOG_TRIPPED}
)
"""After one of these somebody else has decided about the voltage: it is left as it is."""
LONGEST_PERIODS: Final = 2
"""A cycle that comes later does no more than after so many periods: a pause makes no step."""


@dataclass(frozen=True)
class SessionTrace:
    """What was recorded; arrays of one length.

    Attributes:
        t_s: Instants, in s from the first on.
        drive_v: Voltage in force at the instant, as it was written, in V.
        read_back_v: Voltage read back, in V; NaN where there is none.
        position_um: Displacement as the sensor tells it, in µm; NaN where it is not valid.
    """

    t_s: FloatArray
    drive_v: FloatArray
    read_back_v: FloatArray
    position_um: FloatArray

    @property
    def valid_pct(self) -> float:
        """Share of valid samples, in %."""
        return 100.0 * float(np.mean(np.isfinite(self.position_um)))

    def after(self, t_s: float) -> "SessionTrace":
        """Return what was recorded from an instant on."""
        late = self.t_s >= t_s
        return SessionTrace(
            self.t_s[late], self.drive_v[late], self.read_back_v[late], self.position_um[late]
        )


def joined(traces: "list[SessionTrace]") -> SessionTrace:
    """Return traces one after the other, on one time axis."""
    t_s, begin_s = [], 0.0
    for trace in traces:
        t_s.append(begin_s + trace.t_s)
        begin_s += float(trace.t_s[-1] + (trace.t_s[1] - trace.t_s[0]))
    return SessionTrace(
        np.concatenate(t_s),
        np.concatenate([trace.drive_v for trace in traces]),
        np.concatenate([trace.read_back_v for trace in traces]),
        np.concatenate([trace.position_um for trace in traces]),
    )


class Session:
    """Drives one axis; its devices are open and active.

    Args:
        channels: The devices, of this one axis.
        limits: What the drive may do, whatever a step asks for.
        rate_hz: Cycles per second.
        ramp_v_per_s: How fast `go` goes.
        clock: Paces the cycles.
        output_v: Voltage in force, in V, where the amplifier does not read back; else NaN.

    Raises:
        DeviceError: If it is not known which voltage is in force.
    """

    def __init__(
        self,
        channels: Channels,
        limits: Limits,
        rate_hz: float,
        ramp_v_per_s: float,
        clock: Clock,
        output_v: float = nan,
    ) -> None:
        self._channels, self._clock = channels, clock
        self.limits, self.rate_hz, self._ramp_v_per_s = limits, rate_hz, ramp_v_per_s
        self._reads_back = channels.capabilities().read_back
        told_v = channels.read_back(clock.now_ns())[0] if self._reads_back else output_v
        if not isfinite(told_v):
            silent = "does not read back; say which it is with `piezod commission --output-v`"
            raise DeviceError(
                "it is not known which voltage is in force: the amplifier "
                + ("tells none" if self._reads_back else silent)
            )
        slack_v = limits.read_back_tolerance_v
        if not limits.drive_min_v - slack_v <= told_v <= limits.drive_max_v + slack_v:
            raise DeviceError(
                f"{told_v:.2f} V are in force, the axis may be driven from {limits.drive_min_v:g} "
                f"to {limits.drive_max_v:g} V: bring it there first, or correct the limits"
            )
        self.found_v = told_v
        """Voltage in force when the session began, in V."""
        self.drive_v = told_v
        """Voltage in force, in V."""
        self._left_alone = ""
        self._holder: threading.Event | None = None
        self._driving = threading.Lock()
        self._watch = self._new_watch()

    def rest(self, duration_s: float) -> SessionTrace:
        """Hold the voltage, and record.

        Raises:
            DeviceError: If the devices say that something is wrong.
        """
        held_v = self.drive_v
        return self.drive(lambda _t_s: held_v, duration_s)

    def go(self, drive_v: float) -> SessionTrace:
        """Ramp to a voltage, in V, and record.

        Raises:
            DeviceError: If the devices say that something is wrong.
        """
        from_v, way_v = self.drive_v, drive_v - self.drive_v
        duration_s = abs(way_v) / self._ramp_v_per_s

        def ramp_v(t_s: float) -> float:
            return from_v + way_v * min(t_s / duration_s, 1.0) if duration_s else drive_v

        return self.drive(ramp_v, duration_s + max(SETTLE_S, SETTLE_CYCLES / self.rate_hz))

    def back(self) -> SessionTrace:
        """Ramp from the voltage that is read back to where the axis was found.

        Whoever holds the voltage meanwhile does so no more.

        Raises:
            DeviceError: If the devices say that something is wrong, or have said that somebody else
                has changed the voltage: then nothing is driven.
        """
        self._take_over()
        if self._left_alone:
            raise DeviceError(f"the voltage is left as it is, {self._left_alone}")
        self._watch = self._new_watch()  # what was wrong on the way there does not count
        if self._reads_back:
            self.drive_v = self._told_v()
        target_v = min(max(self.found_v, self.limits.drive_min_v), self.limits.drive_max_v)
        trace = self.go(target_v)
        if abs(self.drive_v - target_v) > self.limits.read_back_tolerance_v:
            raise DeviceError(f"the way back to {target_v:.2f} V has ended at {self.drive_v:.2f} V")
        return trace

    @contextmanager
    def holding(self) -> Iterator[None]:
        """Hold the voltage while the block waits for somebody: a device may expect to be asked.

        Raises:
            DeviceError: If the devices say meanwhile that something is wrong.
        """
        ended, troubles = threading.Event(), list[Exception]()

        def hold() -> None:
            try:
                with self._driving:
                    while not ended.is_set():
                        self.rest(HOLD_S)
            except Exception as error:  # noqa: BLE001 - a driver may fail in any way; raised below
                troubles.append(error)

        self._holder = ended
        try:
            threading.Thread(target=hold).start()
            yield
        finally:
            self._take_over()
        if troubles:
            raise troubles[0]

    def _take_over(self) -> None:
        """Be the only thread that drives.

        A signal may end the wait, and it is waited again: a thread whose `join` was left by an
        exception is taken for one that has ended (Python 3.11), a lock is not.
        """
        if self._holder is not None:
            self._holder.set()
            with self._driving:
                pass  # one that begins only now sees that it has ended

    def drive(
        self, wave_v: Callable[[float], float], duration_s: float, rate_hz: float | None = None
    ) -> SessionTrace:
        """Drive a voltage over time, and record.

        Time goes on with every write that is taken, by two periods at most.

        Args:
            wave_v: Voltage in V at a time in s from now.
            duration_s: For how long; for two cycles at least.
            rate_hz: Cycles per second, where not those of the session.

        Raises:
            DeviceError: If the devices say that something is wrong.
        """
        period_ns = round(NS_PER_S / (rate_hz or self.rate_hz))
        # As much time counts for the slew rate as for the wave: else a ramp would fall behind.
        guard = Guard([self.limits], LONGEST_PERIODS * period_ns / NS_PER_S)
        pacer = Pacer(self._clock, period_ns, 0)
        rows: list[tuple[float, float, float, float]] = []
        begin_ns = before_ns = self._clock.now_ns()
        over_s = 0.0
        while len(rows) < 2 or over_s < duration_s:
            pacer.wait()
            now_ns = self._clock.now_ns()
            position_um = self._read(now_ns)
            told_v = self._channels.read_back(now_ns)[0] if self._reads_back else nan
            self._judge(told_v, now_ns)
            rows.append(((now_ns - begin_ns) / NS_PER_S, self.drive_v, told_v, position_um))
            elapsed_s = min(now_ns - before_ns, LONGEST_PERIODS * period_ns) / NS_PER_S
            asked_v = [wave_v(over_s)]
            admitted = guard.admit(now_ns, now_ns, asked_v, [self.drive_v], elapsed_s)
            taken = admitted.writable and self._channels.write(admitted.drive_v, now_ns)
            self._watch.wrote(taken=taken, drive_v=admitted.drive_v[0], now_ns=now_ns)
            if taken:
                self.drive_v, over_s = admitted.drive_v[0], over_s + elapsed_s
            before_ns = now_ns
        return SessionTrace(*np.array(rows).T)

    def _judge(self, told_v: float, now_ns: int) -> None:
        flags = frozenset[DeviceFlag]().union(*self._channels.status(now_ns))
        if elsewhere := flags & ELSEWHERE:
            self._left_alone = ", ".join(sorted(elsewhere))
        self._watch.told(told_v, self.drive_v, flags)

    def _told_v(self) -> float:
        """Return the voltage that is read back, as soon as it is."""
        end_ns = self._clock.now_ns() + s_to_ns(PATIENCE_S)
        while True:
            now_ns = self._clock.now_ns()
            told_v = self._channels.read_back(now_ns)[0]
            if isfinite(told_v):
                return told_v
            if now_ns > end_ns:
                raise DeviceError("the amplifier does not tell which voltage is in force")
            self._clock.sleep_until_ns(now_ns + s_to_ns(1.0 / self.rate_hz))

    def _read(self, now_ns: int) -> float:
        sample = self._channels.read(now_ns)[0]
        return sample.position_um if sample.valid else nan

    def _new_watch(self) -> "_Watch":
        lag_s = LAG_S + self._channels.capabilities().lag_ns / NS_PER_S
        return _Watch(self.limits.read_back_tolerance_v, LAG_CYCLES + int(lag_s * self.rate_hz))


class _Watch:
    """Ends a step where the devices do not do what they are told.

    Args:
        tolerance_v: By how much what is read back may differ from what was written, in V.
        lag_cycles: By how many cycles it may come later.
    """

    def __init__(self, tolerance_v: float, lag_cycles: int) -> None:
        self._tolerance_v, self._written_v = tolerance_v, RecentRange(lag_cycles)
        self._refused_ns = self._off = 0

    def told(self, told_v: float, drive_v: float, flags: frozenset[DeviceFlag]) -> None:
        """Judge what is read back, NaN where nothing is, and what the devices say."""
        if wrong := flags & ENDING:
            raise DeviceError(f"the device says: {', '.join(sorted(wrong))}")
        self._written_v.add(drive_v)
        off_v = max(told_v - self._written_v.high, self._written_v.low - told_v)
        self._off = self._off + 1 if self._tolerance_v < off_v < inf else 0
        if self._off >= OFF_CYCLES:
            raise DeviceError(
                f"the voltage read back is {told_v - drive_v:.1f} V off the one written: check the "
                "calibration of the channel, the load, and that nobody else drives the amplifier"
            )

    def wrote(self, *, taken: bool, drive_v: float, now_ns: int) -> None:
        """Judge a write."""
        if taken:
            self._refused_ns = 0
            return
        self._refused_ns = self._refused_ns or now_ns
        refused_s = (now_ns - self._refused_ns) / NS_PER_S
        if refused_s > PATIENCE_S:
            raise DeviceError(f"the amplifier has refused {drive_v:.2f} V for {refused_s:.1f} s")
