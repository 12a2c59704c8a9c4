"""What a machine can do for the loop of a stage, measured without its devices."""

import gc
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Final, NamedTuple

from piezod.config.daemon import DaemonConfig
from piezod.config.modes import Mode
from piezod.control.assembly import assemble
from piezod.control.controller import StageController
from piezod.control.warm_up import IdealDevices, warm_up, waves_over_the_range
from piezod.daemon.clock import MonotonicClock
from piezod.daemon.last_output import LastOutputWriter
from piezod.daemon.loop.loop import Loop
from piezod.daemon.loop.pacer import Pacer
from piezod.daemon.loop.rate import measure_busy_ns, throttle_part, usable_part, usable_spin_ns
from piezod.daemon.loop.realtime import Realtime
from piezod.daemon.loop.timed_channels import TimedChannels
from piezod.messages.requests import Arm, Request, SelectMode, Wave
from piezod.telemetry.cycle_counts import LIMITS, counts_of
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import SharedMap, create
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S, s_to_ns

PACED_S: Final = 3.5
"""Time for which the loop keeps the configured rate, in s; all takes some 5 s."""
MOST_SKIPPED: Final = 0.001
"""A larger part of skipped cycles says that a machine does not keep a rate."""
_ROUNDS, _CYCLES = 5, 300
_BEAT, _LOOP_BEAT = int(Word.SUPERVISOR_BEAT_NS), int(Word.LOOP_BEAT_NS)


class Machine(NamedTuple):
    """What was measured."""

    cycle_us: float  #: Processor time of a cycle that drives, in µs, without the devices.
    skipped_part: float  #: Part of the cycles at the configured rate that were skipped.
    #: Number of cycles that began that late at the most, by the limit in µs; the last without one.
    late_us: dict[str, int]
    throttle_part: float  #: Part of the time that the kernel leaves to real-time threads.
    rate_hz: int  #: Highest rate that is proposed, in Hz, without the time of the devices.
    missing: tuple[str, ...]  #: Real-time settings that this user does not get.


def measure_machine(config: DaemonConfig) -> Machine:
    """Run the loop of a stage for some seconds, with devices that cost nothing.

    This process gets the real-time settings of the loop meanwhile, as far as its user may.

    Raises:
        ConfigError: If a model file cannot be used.
        DataError: If a model does not hold at the rest voltage.
        ModelError: If a gain is not safe.
    """
    warm_up(config)
    with tempfile.TemporaryDirectory() as folder:
        return _measure(config, Path(folder))


class _HurriedClock:
    """A clock whose sleeps take no time."""

    def __init__(self, t_ns: int) -> None:
        self._t_ns = t_ns

    def now_ns(self) -> int:
        """Return the instant, in ns."""
        return self._t_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Go on."""
        self._t_ns = t_ns


def _measure(config: DaemonConfig, folder: Path) -> Machine:
    shared = create(folder / "loop.map", Layout.of(config))
    clock, devices, period_ns = MonotonicClock(), IdealDevices(config), shared.layout.period_ns
    timed = TimedChannels(devices, clock, LastOutputWriter(folder / "out.map", len(config.axes)))
    controller = assemble(config, timed, devices.capabilities())
    devices.um_per_v = [
        (axis.motion_limits.high_um - axis.motion_limits.low_um)
        / (axis.config.limits.drive_max_v - axis.config.limits.drive_min_v)
        for axis in controller.axes
    ]
    controller.stay_in_boot(False)
    busy_ns = measure_busy_ns(controller, clock)
    realtime, allowed = Realtime(config.loop, shared), os.sched_getaffinity(0)
    missing = tuple(step.name for step in realtime.set_up() if not step.ok)
    try:
        spin_ns = usable_spin_ns(round(config.loop.spin_us * 1000), busy_ns, period_ns)
        loop = Loop(controller, timed, shared, clock, Pacer(clock, period_ns, spin_ns))
        for request in _movement(config, controller):
            _run_until(loop, shared, clock.now_ns() + NS_PER_S // 10)
            controller.execute(request, clock.now_ns())
        _run_until(loop, shared, clock.now_ns() + s_to_ns(PACED_S))
        lateness, skipped = counts_of(shared).lateness, shared.words[Word.SKIPPED_CYCLES]
        hurried = _HurriedClock(clock.now_ns())
        again = Loop(controller, timed, shared, hurried, Pacer(hurried, period_ns, 0))
        cycle_ns = min(_cost_ns(again, shared, hurried) for _ in range(_ROUNDS))
    finally:
        realtime.leave()
        os.sched_setaffinity(0, allowed)
        gc.unfreeze()
        gc.enable()
    limits = [*map(str, LIMITS), "more"]
    skipped_part = skipped / max(sum(lateness.buckets) + skipped, 1)
    rate_hz = usable_part() * NS_PER_S / (cycle_ns + _usual_lateness_ns(lateness.buckets))
    if skipped_part > MOST_SKIPPED:  # the machine does not keep even the configured rate
        rate_hz = min(rate_hz, 0.5 * NS_PER_S / period_ns)
    return Machine(
        cycle_ns / 1e3,
        skipped_part,
        {limit: n for limit, n in zip(limits, lateness.buckets, strict=True) if n},
        throttle_part(),
        _rounded_down(rate_hz),
        missing,
    )


def _usual_lateness_ns(buckets: Sequence[int]) -> float:
    """Return how late all but one of a thousand cycles begin at the most, in ns."""
    most = 0.999 * sum(buckets)
    for limit_us, begun in zip(LIMITS, accumulate(buckets), strict=False):
        if begun >= most:
            return float(1000 * limit_us)
    return float(1000 * LIMITS[-1])


def _movement(config: DaemonConfig, controller: StageController) -> Iterator[Request]:
    """Yield the requests that make all axes move, with all that a cycle can do."""
    yield Arm()
    yield SelectMode(mode=Mode.ADAPTIVE)
    yield Wave(command_um=waves_over_the_range(config, controller), duration_s=3600.0)


def _run_until(loop: Loop, shared: SharedMap, t_ns: int) -> None:
    """Run cycles until an instant, as if a supervisor lived."""
    while shared.words[_LOOP_BEAT] < t_ns:
        shared.words[_BEAT] = shared.words[_LOOP_BEAT]
        loop.cycle()


def _cost_ns(loop: Loop, shared: SharedMap, clock: _HurriedClock) -> float:
    """Return the processor time of a cycle, in ns."""
    begin_ns = time.thread_time_ns()
    _run_until(loop, shared, clock.now_ns() + _CYCLES * shared.layout.period_ns)
    return (time.thread_time_ns() - begin_ns) / _CYCLES


def _rounded_down(rate_hz: float) -> int:
    """Return a rate with two digits."""
    unit = 10 ** max(len(str(int(rate_hz))) - 2, 0)
    return int(rate_hz // unit * unit)
