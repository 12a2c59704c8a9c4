"""Manual driving of one axis: slowly, within its limits, and back to its initial voltage.

Its cycle is not `control.cycle`, because nothing is known of a new axis: no law computes the
voltage, a refused write makes the waveform wait, and the end is the voltage that was found.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import compress
from math import isfinite, nan
from typing import Final

import numpy as np

from piezod.commission.cycles import SessionCycles
from piezod.commission.device_watch import DeviceWatch
from piezod.commission.output import Output
from piezod.commission.session_trace import SessionTrace
from piezod.control.guard import Guard, Limits
from piezod.daemon.clock import Clock
from piezod.devices.channels import Channels
from piezod.devices.status import MOVED, DeviceFlag
from piezod.errors import DeviceError
from piezod.experiment.lateness import Lateness
from piezod.units import NS_PER_S

HOLD_S: Final = 0.1
"""Period, in s, with which a held voltage checks whether the wait is over."""
LAG_CYCLES, LAG_S = 3, 0.1
"""Allowed delay of the read-back behind the write: a number of cycles plus a time in s."""
SETTLE_CYCLES, SETTLE_S = 4, 0.05
"""Extra duration of a ramp, in cycles or in s, so that its last write is its end voltage."""
LEAST_ROWS: Final = 2
"""Smallest number of rows in a trace."""


class Session:
    """Drives one axis; its devices are open and active.

    Raises:
        DeviceError: If the voltage in force is unknown, or outside the limits.
    """

    def __init__(
        self,
        channels: Channels,
        output: Output,
        limits: Limits,
        rate_hz: float,
        ramp_v_per_s: float,
        clock: Clock,
    ) -> None:
        self._channels, self._output, self._clock = channels, output, clock
        self.limits, self.rate_hz, self._ramp_v_per_s = limits, rate_hz, ramp_v_per_s
        self._lateness = Lateness()
        output.find()
        initial_v = output.drive_v
        slack_v = limits.read_back_tolerance_v
        if not limits.drive_min_v - slack_v <= initial_v <= limits.drive_max_v + slack_v:
            raise DeviceError(
                f"{initial_v:.2f} V are in force, outside the limits of {limits.drive_min_v:g} "
                f"to {limits.drive_max_v:g} V: bring the axis there first, or correct the limits"
            )
        self.found_v = initial_v
        """Initial voltage of the session, in V."""
        self._shown_v, self._shown_ns = output.read_back_v(clock.now_ns()), clock.now_ns()
        self._not_ours = ""  # flags after which the voltage must not be driven any more
        self._holder: threading.Event | None = None
        self._driving = threading.Lock()
        self._watch = self._new_watch()

    @property
    def drive_v(self) -> float:
        """Voltage in force, in V."""
        return self._output.drive_v

    def rest(self, duration_s: float) -> SessionTrace:
        """Hold the voltage and record.

        Raises:
            DeviceError: If a device reports a fault.
        """
        held_v = self.drive_v
        return self.drive(lambda _t_s: held_v, duration_s)

    def go(self, drive_v: float) -> SessionTrace:
        """Ramp to a voltage, in V, and record.

        Raises:
            DeviceError: If a device reports a fault.
        """
        from_v, way_v = self.drive_v, drive_v - self.drive_v
        duration_s = abs(way_v) / self._ramp_v_per_s

        def ramp_v(t_s: float) -> float:
            return from_v + way_v * min(t_s / duration_s, 1.0) if duration_s else drive_v

        return self.drive(ramp_v, duration_s + max(SETTLE_S, SETTLE_CYCLES / self.rate_hz))

    def back(self) -> SessionTrace:
        """Ramp from the voltage in force to the initial voltage of the session.

        A thread that holds the voltage is ended first.

        Raises:
            DeviceError: If a device reports a fault, or has reported that something else has
                changed the voltage, or if the voltage is unknown: then nothing is driven.
        """
        self._take_over()
        if self._not_ours:
            raise DeviceError(f"the voltage is left as it is: {self._not_ours}")
        self._watch = self._new_watch()  # earlier problems must not prevent the way back
        self._output.find()
        target_v = min(max(self.found_v, self.limits.drive_min_v), self.limits.drive_max_v)
        trace = self.go(target_v)
        if abs(self.drive_v - target_v) > self.limits.read_back_tolerance_v:
            raise DeviceError(f"the ramp back to {target_v:.2f} V ended at {self.drive_v:.2f} V")
        return trace

    @contextmanager
    def holding(self) -> Iterator[None]:
        """Hold the voltage while the block waits: a device may have a watchdog.

        Raises:
            DeviceError: If a device reports a fault meanwhile.
        """
        ended, errors = threading.Event(), list[Exception]()

        def hold() -> None:
            try:
                with self._driving:
                    while not ended.is_set():
                        self.rest(HOLD_S)
            except Exception as error:  # noqa: BLE001 - a driver may fail in any way; raised below
                errors.append(error)

        self._holder = ended
        try:
            threading.Thread(target=hold).start()
            yield
        finally:
            self._take_over()
        if errors:
            raise errors[0]

    def _take_over(self) -> None:
        """End the thread that holds the voltage, and wait for it.

        A signal may end the wait, so that it has to be repeated. A lock allows that; `join` does
        not: in Python 3.11 a thread counts as ended after its `join` was left by an exception.
        """
        if self._holder is not None:
            self._holder.set()
            with self._driving:
                pass  # a thread that starts only now sees the event and ends

    def drive(
        self, wave_v: Callable[[float], float], duration_s: float, rate_hz: float | None = None
    ) -> SessionTrace:
        """Drive a voltage over time and record; leave out late cycles without a valid sample.

        The time of the waveform advances with every accepted write, by at most a period: after a
        late cycle the voltage makes no jump.

        Args:
            wave_v: Function from the time in s to the voltage in V.
            duration_s: Duration in s; at least two cycles are driven.
            rate_hz: Cycles per second, if they differ from the session.

        Raises:
            DeviceError: If a device reports a fault.
        """
        cycles = SessionCycles(self._clock, rate_hz or self.rate_hz)
        guard = Guard([self.limits], cycles.period_ns / NS_PER_S)
        rows, told = list[tuple[float, float, float, float]](), list[bool]()
        begin_ns = before_ns = self._clock.now_ns()
        wave_s = 0.0  # time of the waveform
        try:
            while len(rows) < LEAST_ROWS or wave_s < duration_s:
                late = cycles.wait()
                now_ns = self._clock.now_ns()
                position_um = self._read(now_ns)
                read_back_v = self._output.read_back_v(now_ns)
                flags = self._flags(now_ns)
                late |= cycles.note(flags)
                self._watch.check_read_back(read_back_v, self.drive_v, flags)
                # Before the write: a sample belongs to the voltage in force when it was taken.
                t_s = (now_ns - begin_ns) / NS_PER_S
                rows.append((t_s, self.drive_v, read_back_v, position_um))
                told.append(isfinite(position_um) or not late)
                # The slew limit has the same time step as the waveform, or a ramp would lag behind.
                elapsed_s = min(now_ns - before_ns, cycles.period_ns) / NS_PER_S
                # After a refused write the waveform waits, so that it continues without a jump.
                if self._write(guard, wave_v(wave_s), read_back_v, now_ns, elapsed_s):
                    wave_s += elapsed_s
                before_ns = now_ns
        finally:
            self._lateness = self._lateness.plus(cycles.lateness)
        # A sample that is missing because it is late says nothing about the sensor.
        used = list(compress(rows, told)) if sum(told) >= LEAST_ROWS else rows
        return SessionTrace(*np.array(used).T)

    def take_lateness(self) -> Lateness:
        """Return the lateness of all driving since the last call."""
        taken, self._lateness = self._lateness, Lateness()
        return taken

    def _write(
        self, guard: Guard, wished_v: float, read_back_v: float, now_ns: int, elapsed_s: float
    ) -> bool:
        """Write a voltage as the guard admits it; return whether it was accepted."""
        if isfinite(read_back_v):
            self._shown_v = read_back_v
            self._shown_ns = now_ns - self._channels.read_back_age_ns(now_ns)[0]
        admitted = guard.admit(
            now_ns,
            now_ns,
            [wished_v],
            [self.drive_v],
            elapsed_s,
            [self._output.sent_v],
            read_back_v=[self._shown_v],
            age_s=[(now_ns - self._shown_ns) / NS_PER_S],
        )
        waits = bool(admitted.waits)
        self._watch.check_wait(read_back_v, self.drive_v, now_ns, waits=waits)
        if waits:
            return False
        (drive_v,) = admitted.drive_v
        accepted = admitted.writable and self._output.write(drive_v, now_ns)
        self._watch.check_write(accepted=accepted, drive_v=drive_v, now_ns=now_ns)
        return accepted

    def _flags(self, now_ns: int) -> frozenset[DeviceFlag]:
        flags = frozenset[DeviceFlag]().union(*self._channels.status(now_ns))
        if elsewhere := flags & MOVED:  # the session leaves the voltage as it is
            self._not_ours = ", ".join(sorted(elsewhere))
        return flags

    def _read(self, now_ns: int) -> float:
        sample = self._channels.read(now_ns)[0]
        return sample.position_um if sample.valid else nan

    def _new_watch(self) -> DeviceWatch:
        lag_s = LAG_S + self._channels.capabilities().lag_ns / NS_PER_S
        return DeviceWatch(
            self.limits.read_back_tolerance_v, LAG_CYCLES + int(lag_s * self.rate_hz)
        )
