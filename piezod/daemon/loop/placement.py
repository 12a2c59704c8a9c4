"""Decides where each device is used: in the cycle, in one combined exchange, or behind a worker.

The framework decides, not the driver. It measures the round trips of each device before the loop
begins; it writes nothing for that.
"""

import os
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from enum import StrEnum
from math import inf
from typing import Any, Final, NamedTuple, cast

from piezod.daemon.clock import Clock
from piezod.daemon.loop.worker import DeviceWorker
from piezod.devices.interface import Capabilities, Device, Exchanges, Identity
from piezod.devices.player import Player, PlayerCapabilities
from piezod.devices.reconnecting import CanBeLost, ReconnectingDevice
from piezod.devices.wrapper import AnyDevice, CombinedExchange
from piezod.errors import DeviceError
from piezod.units import NS_PER_S

MIN_ROUNDS, MAX_ROUNDS = 5, 100
MAX_DURATION_NS: Final = NS_PER_S // 2
IN_CYCLE_PART: Final = 0.5
"""Part of a period that all devices in the cycle may take together; the rest is for control."""
SWITCH_INTERVAL_S: Final = 1e-4
"""How long a thread may keep the interpreter while another one waits, in s: less than Python's
5 ms, because the thread that waits is the loop."""


class DevicePlace(StrEnum):
    """The place of a device."""

    CYCLE = "in the cycle"
    COMBINED = "in the cycle, one exchange"
    WORKER = "behind a worker"


class RoundTrips(NamedTuple):
    """How long reading and reading back take."""

    median_ns: int  #: Median of the round trips.
    #: Their 90th percentile. Longer ones are mostly pauses of the machine, which a worker thread
    #: would not avoid.
    p90_ns: int
    p99_ns: int  #: Their 99th percentile.
    #: Assumed duration of a write, which is not tried: the 90th percentile of the longer exchange
    #: of a round trip. Meaningless without exchanges, see `cost_ns`.
    write_ns: int
    usual_write_ns: int  #: The same, at the median.


class Placement(NamedTuple):
    """Where a device is used, and why."""

    name: str  #: Name of the device.
    place: DevicePlace  #: Where it is used.
    trips: RoundTrips  #: Its round trips.
    identity: Identity  #: Its identity.
    able: Capabilities  #: Its capabilities.
    #: Highest rate of a loop that it can give samples for; infinite without an input.
    allowed_hz: float
    device: Device  #: The object to use: the device, or a wrapper of it.
    threads: Sequence[threading.Thread]  #: The threads of the wrappers, not started.
    #: The wrapper that opens it again after a loss; None if it cannot be lost.
    link: ReconnectingDevice | None
    player: PlayerCapabilities | None = None  #: Those of a device that plays.

    def document(self) -> dict[str, Any]:
        """Return it as JSON for status and API."""
        return {
            "name": self.name,
            "identity": self.identity._asdict(),
            "placement": str(self.place),
            "round_trip_us": {
                "p50": self.trips.median_ns / 1000,
                "p99": self.trips.p99_ns / 1000,
            },
            "capabilities": self.able._asdict(),
            "edge_waits": self.player.edge_waits if self.player else 0,
            "pulses_at": self.player.pulses_at if self.player else (),
        }


def measure(device: Device, able: Capabilities, clock: Clock) -> RoundTrips:
    """Read a device and its read-back again and again, as a cycle does; return the durations.

    Args:
        device: The device, open and active.
        able: Its capabilities.
        clock: The clock of the loop.
    """
    any_role, now_ns = cast("AnyDevice", device), clock.now_ns
    rounds: list[int] = []
    single: list[int] = []
    begin_ns = now_ns()
    while len(rounds) < MIN_ROUNDS or (
        len(rounds) < MAX_ROUNDS and now_ns() - begin_ns < MAX_DURATION_NS
    ):
        t_ns = read_ns = now_ns()
        with suppress(Exception):  # a driver may fail in any way; the loop will report it
            if able.inputs:
                any_role.read(t_ns)
            read_ns = now_ns()
            if able.outputs:
                any_role.read_back(t_ns)
        end_ns = now_ns()
        rounds.append(end_ns - t_ns)
        # The longer of the two is taken for the duration of a write.
        single.append(max(read_ns - t_ns, end_ns - read_ns))
    rounds.sort()
    single.sort()
    return RoundTrips(
        _exceeded_by_one_in(rounds, 2),
        _exceeded_by_one_in(rounds, 10),
        _exceeded_by_one_in(rounds, 100),
        _exceeded_by_one_in(single, 10),
        _exceeded_by_one_in(single, 2),
    )


def _exceeded_by_one_in(ordered: Sequence[int], n: int) -> int:
    """Return the duration that one of n exceeds."""
    return ordered[-1 - len(ordered) // n]


def place(
    devices: Mapping[str, Device],
    identities: Mapping[str, Identity],
    rate_hz: float,
    clock: Clock,
) -> list[Placement]:
    """Measure devices, and decide where each is used; create the threads, start none.

    The devices with the lowest cost come first into the cycle, until it is full.

    Args:
        devices: The devices by name, open and active.
        identities: Their identities.
        rate_hz: Rate of the loop.
        clock: The clock of the loop.
    """
    measured = {name: measure(each, each.capabilities(), clock) for name, each in devices.items()}
    period_ns = round(NS_PER_S / rate_hz)
    left_ns, placements = IN_CYCLE_PART * period_ns, {}
    costs_ns = {
        name: cost_ns(each.capabilities(), measured[name]) for name, each in devices.items()
    }
    # Cheapest first, so that as many devices as possible are in the cycle.
    for name in sorted(devices, key=costs_ns.__getitem__):
        device, trips = devices[name], measured[name]
        chosen, taken_ns = _choose_place(device, trips, rate_hz, left_ns)
        left_ns -= taken_ns
        placements[name] = _make_placement(
            name, device, trips, identities[name], chosen, period_ns=period_ns, clock=clock
        )
    return [placements[name] for name in devices]  # in the order of the configuration


def cost_ns(able: Capabilities, trips: RoundTrips) -> int:
    """Return how long a device is read, written and read back in a cycle, in turn, in ns."""
    return trips.p90_ns + _write_ns(able, trips)


def _write_ns(able: Capabilities, trips: RoundTrips) -> int:
    """Return the assumed duration of a write, in ns, which is not measured."""
    if not able.outputs:
        return 0
    if able.inputs or able.read_back:
        return trips.write_ns
    # No exchange was measured: assume that a write takes as long as the highest rate allows.
    return round(NS_PER_S / able.max_rate_hz)


def _choose_place(
    device: Device, trips: RoundTrips, rate_hz: float, left_ns: float
) -> tuple[DevicePlace, int]:
    """Return where a device is used, and how much of the cycle that takes, in ns."""
    able = device.capabilities()
    separate_ns = cost_ns(able, trips)
    # A slow amplifier goes behind a worker; a slow sensor is refused later, by `rate_refusal`.
    if able.max_rate_hz < rate_hz and not able.inputs:
        return DevicePlace.WORKER, 0
    if separate_ns <= left_ns:
        return DevicePlace.CYCLE, separate_ns
    if _can_combine(device, able) and trips.p90_ns <= left_ns:
        return DevicePlace.COMBINED, trips.p90_ns
    return DevicePlace.WORKER, 0


def _can_combine(device: Device, able: Capabilities) -> bool:
    return isinstance(device, Exchanges) and bool(able.inputs and able.outputs)


def _make_placement(
    name: str,
    device: Device,
    trips: RoundTrips,
    identity: Identity,
    chosen: DevicePlace,
    *,
    period_ns: int,
    clock: Clock,
) -> Placement:
    """Put the wrappers around a device that its place needs."""
    able, used = device.capabilities(), device
    allowed_hz = able.max_rate_hz if able.inputs else inf
    threads, link = [], None
    if isinstance(device, CanBeLost):
        used = link = ReconnectingDevice(device, identity)
        threads.append(link.thread)
    if chosen is DevicePlace.COMBINED:
        used = CombinedExchange(used)
    elif chosen is DevicePlace.WORKER:
        combined = _can_combine(device, able)
        # The 99th percentile, because a round of twice this duration counts as late.
        round_ns = trips.p99_ns + (0 if combined else _write_ns(able, trips))
        # The worker keeps to the rate that the driver reports, however fast the replies are.
        pace_ns = round(NS_PER_S / able.max_rate_hz)
        used = worker = DeviceWorker(
            used,
            clock,
            period_ns,
            round_ns,
            exchanges=combined,
            pace_ns=pace_ns if pace_ns > period_ns else 0,
        )
        threads.append(worker.thread)
        if able.inputs:
            # By the median: single cycles without a sample are no reason to refuse a rate.
            writes = not combined and bool(able.outputs)
            usual_ns = trips.median_ns + writes * trips.usual_write_ns
            allowed_hz = min(allowed_hz, NS_PER_S / usual_ns)
    player = _player_of(device)
    return Placement(name, chosen, trips, identity, able, allowed_hz, used, threads, link, player)


def _player_of(device: Device) -> PlayerCapabilities | None:
    with suppress(DeviceError):  # it tells why when something is to be played
        return device.player_capabilities() if isinstance(device, Player) else None
    return None


def rate_refusal(placements: Sequence[Placement], rate_hz: float) -> str:
    """Return a message on a device that is too slow to measure a stage at this rate, or ""."""
    for one in placements:
        if rate_hz > one.allowed_hz:
            took_ms = one.trips.median_ns / 1e6
            return (
                f"rate_hz is {rate_hz:g}; device {one.name} measures at most "
                f"{one.allowed_hz:.3g} times a second (round trip {took_ms:.3g} ms): choose a "
                "lower rate"
            )
    return ""


def start_threads(placements: Sequence[Placement]) -> int:
    """Start the threads of all devices; return their number."""
    threads = [thread for one in placements for thread in one.threads]
    if threads:
        sys.setswitchinterval(SWITCH_INTERVAL_S)
    for thread in threads:
        thread.start()
    return len(threads)


def raise_thread_priorities(placements: Sequence[Placement]) -> None:
    """Give the workers the priority one below that of the loop, if it has a real-time priority."""
    priority = os.sched_getparam(0).sched_priority
    if priority < 2:  # no lower priority exists
        return
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    for one in placements:
        if one.place is DevicePlace.WORKER:
            # The last thread is the worker; a thread that reconnects stays ordinary.
            native_id = one.threads[-1].native_id
            if native_id is not None:
                os.sched_setscheduler(native_id, policy, os.sched_param(priority - 1))
