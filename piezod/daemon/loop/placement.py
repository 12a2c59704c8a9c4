"""Where each device is used: in the cycle, with one exchange for both roles, or behind a worker.

The framework decides, not the driver, by what it measures: round trips of each device before the
loop begins. Nothing is written for that.
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
from piezod.devices.reconnecting import CanBeLost, ReconnectingDevice
from piezod.devices.wrapper import AnyDevice, CombinedExchange
from piezod.units import NS_PER_S

LEAST_ROUNDS, MOST_ROUNDS = 5, 100
LONGEST_NS: Final = NS_PER_S // 2
IN_CYCLE_PART: Final = 0.5
"""Part of a period that all devices together may take in the cycle; the rest is for control."""
SWITCH_S: Final = 1e-4
"""How long a thread may run on while another one waits for the interpreter: less than usual, since
the one that waits is the loop."""
STACK_BYTES: Final = 1 << 20
"""Of each thread; all of it will be locked in memory."""


class DevicePlace(StrEnum):
    """Where a device is used."""

    CYCLE = "in the cycle"
    COMBINED = "in the cycle, one exchange"
    WORKER = "behind a worker"


class RoundTrips(NamedTuple):
    """How long a device takes to tell what it measures and what is in force.

    Attributes:
        median_ns: Half of the round trips took no longer.
        p90_ns: Nine of ten took no longer. What is rarer is mostly the machine standing still,
            which a thread would not be spared.
        p99_ns: 99 of 100 took no longer.
        write_ns: What a write, which is not tried, is taken to cost in nine of ten: the longest of
            the exchanges. Where there are none it tells nothing, see `cost_ns`.
        usual_write_ns: The same, at its median.
    """

    median_ns: int
    p90_ns: int
    p99_ns: int
    write_ns: int
    usual_write_ns: int


class Placement(NamedTuple):
    """Where a device is used, and why.

    Attributes:
        name: Name of the device.
        place: Where.
        trips: How long it takes.
        identity: Who it is.
        able: What it can do.
        allowed_hz: The highest rate of a loop that it can give samples for; infinite where it
            measures nothing.
        device: What is to be used for it.
        threads: What belongs to it, to be started.
    """

    name: str
    place: DevicePlace
    trips: RoundTrips
    identity: Identity
    able: Capabilities
    allowed_hz: float
    device: Device
    threads: Sequence[threading.Thread]

    def document(self) -> dict[str, Any]:
        """Return it as it is shown."""
        return {
            "name": self.name,
            "identity": self.identity._asdict(),
            "placement": str(self.place),
            "round_trip_us": {
                "p50": self.trips.median_ns / 1000,
                "p99": self.trips.p99_ns / 1000,
            },
            "capabilities": self.able._asdict(),
        }


def measure(device: Device, able: Capabilities, clock: Clock) -> RoundTrips:
    """Ask a device again and again what it measures, and what is in force, as a cycle does.

    Args:
        device: The device, open and active.
        able: What it can do.
        clock: The clock of the loop.
    """
    asked, now_ns = cast("AnyDevice", device), clock.now_ns
    rounds: list[int] = []
    single: list[int] = []
    begin_ns = now_ns()
    while len(rounds) < LEAST_ROUNDS or (
        len(rounds) < MOST_ROUNDS and now_ns() - begin_ns < LONGEST_NS
    ):
        t_ns = read_ns = now_ns()
        with suppress(Exception):  # a driver may fail in any way; the loop tells it, and goes on
            if able.inputs:
                asked.read(t_ns)
            read_ns = now_ns()
            if able.outputs:
                asked.read_back(t_ns)
        end_ns = now_ns()
        rounds.append(end_ns - t_ns)
        single.append(max(read_ns - t_ns, end_ns - read_ns))
    rounds.sort()
    single.sort()
    return RoundTrips(
        _upper(rounds, 2),
        _upper(rounds, 10),
        _upper(rounds, 100),
        _upper(single, 10),
        _upper(single, 2),
    )


def _upper(ordered: Sequence[int], one_of: int) -> int:
    """Return what one of so many exceeds."""
    return ordered[-1 - len(ordered) // one_of]


def place(
    devices: Mapping[str, Device],
    identities: Mapping[str, Identity],
    rate_hz: float,
    clock: Clock,
) -> list[Placement]:
    """Measure devices, and decide where each is used; threads are made and not started.

    Those that take least come first into the cycle, as long as there is time left in it.

    Args:
        devices: The devices by name, open and active.
        identities: Who each of them is.
        rate_hz: Rate of the loop.
        clock: The clock of the loop.
    """
    measured = {name: measure(each, each.capabilities(), clock) for name, each in devices.items()}
    period_ns = round(NS_PER_S / rate_hz)
    left_ns, placements = IN_CYCLE_PART * period_ns, {}
    costs_ns = {
        name: cost_ns(each.capabilities(), measured[name]) for name, each in devices.items()
    }
    for name in sorted(devices, key=costs_ns.__getitem__):
        device, trips = devices[name], measured[name]
        where, taken_ns = _where(device, trips, rate_hz, left_ns)
        left_ns -= taken_ns
        placements[name] = _placed(
            name, device, trips, identities[name], where, period_ns=period_ns, clock=clock
        )
    return [placements[name] for name in devices]


def cost_ns(able: Capabilities, trips: RoundTrips) -> int:
    """Return how much of a cycle a device takes that is read, written and read back in turn.

    Args:
        able: What it can do.
        trips: How long it takes.
    """
    return trips.p90_ns + _write_ns(able, trips)


def _write_ns(able: Capabilities, trips: RoundTrips) -> int:
    """Return how long a write takes: where no exchange tells, as long as the device allows."""
    if not able.outputs:
        return 0
    if able.inputs or able.read_back:
        return trips.write_ns
    return round(NS_PER_S / able.max_rate_hz)


def _where(
    device: Device, trips: RoundTrips, rate_hz: float, left_ns: float
) -> tuple[DevicePlace, int]:
    """Return where a device is used, and how much of the cycle that takes."""
    able = device.capabilities()
    separate_ns = cost_ns(able, trips)
    if able.max_rate_hz < rate_hz and not able.inputs:
        return DevicePlace.WORKER, 0
    if separate_ns <= left_ns:
        return DevicePlace.CYCLE, separate_ns
    if _exchanges(device, able) and trips.p90_ns <= left_ns:
        return DevicePlace.COMBINED, trips.p90_ns
    return DevicePlace.WORKER, 0


def _exchanges(device: Device, able: Capabilities) -> bool:
    return isinstance(device, Exchanges) and bool(able.inputs and able.outputs)


def _placed(
    name: str,
    device: Device,
    trips: RoundTrips,
    identity: Identity,
    where: DevicePlace,
    *,
    period_ns: int,
    clock: Clock,
) -> Placement:
    able, used = device.capabilities(), device
    allowed_hz = able.max_rate_hz if able.inputs else inf
    threads = []
    if isinstance(device, CanBeLost):
        used = tended = ReconnectingDevice(device, identity)
        threads.append(tended.thread)
    if where is DevicePlace.COMBINED:
        used = CombinedExchange(used)
    elif where is DevicePlace.WORKER:
        combined = _exchanges(device, able)
        round_ns = trips.p99_ns + (0 if combined else _write_ns(able, trips))
        # One that says it is slower than the loop is not asked more often, however fast it answers.
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
        if able.inputs:  # a cycle without a sample now and then is no reason to refuse
            writes = not combined and bool(able.outputs)
            usual_ns = trips.median_ns + writes * trips.usual_write_ns
            allowed_hz = min(allowed_hz, NS_PER_S / usual_ns)
    return Placement(name, where, trips, identity, able, allowed_hz, used, threads)


def refusal(placements: Sequence[Placement], rate_hz: float) -> str:
    """Say which device is too slow to measure a stage at this rate; nothing where none is."""
    for one in placements:
        if rate_hz > one.allowed_hz:
            took_ms = one.trips.median_ns / 1e6
            return (
                f"rate_hz is {rate_hz:g}; device {one.name} measures at most "
                f"{one.allowed_hz:.3g} times a second, its round trip takes {took_ms:.3g} ms: "
                "choose a lower rate"
            )
    return ""


def start_threads(placements: Sequence[Placement]) -> int:
    """Start the threads of all devices; return how many there are."""
    threads = [thread for one in placements for thread in one.threads]
    if threads:
        sys.setswitchinterval(SWITCH_S)
    before = threading.stack_size(STACK_BYTES)
    for thread in threads:
        thread.start()
    threading.stack_size(before)
    return len(threads)


def raise_threads(placements: Sequence[Placement]) -> None:
    """Have the workers run before all but the loop, one below it, where it has a priority."""
    priority = os.sched_getparam(0).sched_priority
    if priority < 2:  # there is none below
        return
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    for one in placements:
        if one.place is DevicePlace.WORKER:
            native_id = one.threads[-1].native_id
            if native_id is not None:
                os.sched_setscheduler(native_id, policy, os.sched_param(priority - 1))
