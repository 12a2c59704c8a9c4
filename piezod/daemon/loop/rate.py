"""Measures the highest rate of the loop with its own devices, before anything may be armed."""

from math import ceil
from pathlib import Path
from statistics import median
from typing import Final

from piezod.control.watch.loop import CycleTiming
from piezod.daemon.clock import Clock, clock_offsets_ns
from piezod.daemon.loop.loop import Controller
from piezod.units import NS_PER_S

MIN_CYCLES, MAX_CYCLES = 9, 200
MAX_DURATION_NS: Final = NS_PER_S // 4
THROTTLE: Final = (
    Path("/proc/sys/kernel/sched_rt_runtime_us"),
    Path("/proc/sys/kernel/sched_rt_period_us"),
)
"""Time that the kernel leaves to real-time threads, and out of which: 950 ms of each second unless
somebody has changed it. A thread that uses more stands still for the rest."""
ROOM_PART: Final = 0.15
"""Part of a period that the loop leaves below that limit."""
DRIVING: Final = 1.5
"""A cycle that drives takes up to this many times as long as a measured one."""
QUIET_PART: Final = 0.5
"""Part of a period that a measured cycle may take. It writes nothing and its data are in the
caches; a cycle that drives takes `DRIVING` times as long, and publishing comes on top."""


def throttle_part() -> float:
    """Return the part of the time that the kernel leaves to real-time threads, 1 without limit."""
    try:
        runtime_us, period_us = (int(path.read_text()) for path in THROTTLE)
    except (OSError, ValueError):
        return 1.0
    return 1.0 if runtime_us < 0 else min(runtime_us / period_us, 1.0)


def usable_part() -> float:
    """Return the part of a period that cycle and spinning may use together."""
    return max(throttle_part() - ROOM_PART, 0.0)


def measure_busy_ns(controller: Controller, clock: Clock, pause_ns: int = 0) -> int:
    """Return how long a cycle takes, devices included, in ns: the median of up to 200 cycles.

    The cycles run one after the other, before the stage is armed.

    Args:
        controller: Runs the cycles.
        clock: The clock of the loop.
        pause_ns: Pause between two cycles, in ns, during which device threads can work.
    """
    durations_ns: list[int] = []
    begin_ns = clock.now_ns()
    while len(durations_ns) < MIN_CYCLES or (  # fewer, and one delayed cycle would count
        len(durations_ns) < MAX_CYCLES and clock.now_ns() - begin_ns < MAX_DURATION_NS
    ):
        t_ns = clock.now_ns()
        controller.cycle(t_ns, CycleTiming(0, 0, 0, *clock_offsets_ns()))
        durations_ns.append(clock.now_ns() - t_ns)
        if pause_ns:
            clock.sleep_until_ns(clock.now_ns() + pause_ns)
    return round(median(durations_ns))


def sustained_rate_hz(busy_ns: int) -> float:
    """Return the highest rate for a measured cycle of this duration, in Hz."""
    return QUIET_PART * NS_PER_S / busy_ns


def kept_period_ns(period_ns: int, busy_ns: int) -> int:
    """Return the period, or the smallest multiple of it that leaves time for other programs.

    A stage whose rate is too high is not armed. Its loop still observes it, and without this it
    would take a processor for itself.

    Args:
        period_ns: Configured period, in ns.
        busy_ns: Duration of a measured cycle, in ns.
    """
    return period_ns * ceil(busy_ns / (QUIET_PART * period_ns))


def usable_spin_ns(asked_ns: int, busy_ns: int, period_ns: int) -> int:
    """Return how long the loop may spin before a deadline and still sleep in each period, in ns.

    Args:
        asked_ns: Configured time, in ns.
        busy_ns: Duration of a measured cycle, in ns.
        period_ns: Period, in ns.
    """
    return max(0, min(asked_ns, round(usable_part() * period_ns - DRIVING * busy_ns)))
