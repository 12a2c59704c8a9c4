"""How fast a loop can be: measured with its own devices before anything may be armed."""

from statistics import median
from typing import Final

from piezod.control.watch.loop import CycleTiming
from piezod.daemon.clock import Clock, clock_offsets_ns
from piezod.daemon.loop.loop import Controller
from piezod.units import NS_PER_S

LEAST_CYCLES, MOST_CYCLES = 9, 200
LONGEST_NS: Final = NS_PER_S // 4
USABLE_PART: Final = 0.8
"""Part of a period that may be used up: the kernel takes a twentieth of each second from a
real-time thread that never sleeps."""
QUIET_PART: Final = 0.5
"""What is measured is a cycle that writes nothing, with all it needs at hand; it may take this part
of a period. One that drives takes up to half as long again, and publishing comes on top."""


def measure_busy_ns(controller: Controller, clock: Clock, pause_ns: int = 0) -> int:
    """Return how long a cycle takes, devices included: the median over up to 200 of them.

    They run one after the other, before the stage is armed.

    Args:
        controller: What runs a cycle.
        clock: The clock of the loop.
        pause_ns: Pause between two cycles, in which threads that have devices do their work.
    """
    durations_ns: list[int] = []
    begin_ns = clock.now_ns()
    while len(durations_ns) < LEAST_CYCLES or (  # a single one may have been held up
        len(durations_ns) < MOST_CYCLES and clock.now_ns() - begin_ns < LONGEST_NS
    ):
        t_ns = clock.now_ns()
        controller.cycle(t_ns, CycleTiming(0, 0, 0, *clock_offsets_ns()))
        durations_ns.append(clock.now_ns() - t_ns)
        if pause_ns:
            clock.sleep_until_ns(clock.now_ns() + pause_ns)
    return round(median(durations_ns))


def sustained_rate_hz(busy_ns: int) -> float:
    """Return the highest rate at which a cycle may take so long."""
    return QUIET_PART * NS_PER_S / busy_ns


def usable_spin_ns(asked_ns: int, busy_ns: int, period_ns: int) -> int:
    """Return how long the loop may spin before a deadline, so that it also sleeps."""
    return max(0, min(asked_ns, round(USABLE_PART * period_ns) - busy_ns))
