"""Looks at the devices of a stage: who they are, what they can do, how fast; moves nothing.

A device is opened twice. With all its channels it tells who it is and what is in force; its outputs
are not taken control of. With its inputs alone it is activated and read.
"""

from collections.abc import Callable, Iterable, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final, NamedTuple

from piezod.daemon.clock import Clock
from piezod.daemon.loop.placement import IN_CYCLE_PART, RoundTrips, cost_ns
from piezod.devices import registry
from piezod.devices.interface import (
    Amplifier,
    Capabilities,
    ChannelUnits,
    Device,
    Identity,
    Sensor,
    Wiring,
)
from piezod.devices.wiring import ChannelPair, wiring_of
from piezod.errors import DeviceError
from piezod.units import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Iterator

    from piezod.config.daemon import DaemonConfig

EXCHANGES: Final = 200
ALL_PCT: Final = 100.0


class RoundTrip(NamedTuple):
    """How long an exchange takes, in µs.

    Attributes:
        median_us: Half of them are faster.
        p90_us: Nine of ten of them are; these count for the rate.
        p99_us: 99 % of them are.
        failed_pct: Share of them that gave nothing, in %.
    """

    median_us: float
    p90_us: float
    p99_us: float
    failed_pct: float


class Probed(NamedTuple):
    """What a device tells.

    Attributes:
        driver: Name of its driver.
        identity: Who it is; None where it could not be opened.
        capabilities: What it can do; None likewise.
        units: The unit of each channel that is used, where the driver tells.
        in_force: What is in force on each output, by name.
        readings: What each input reads, by name; NaN where that is not valid.
        read: Round trip of reading; None where it has no inputs.
        read_back: Round trip of reading back; None where it does not.
        cost_ns: How much of a cycle its exchanges take.
        rate_hz: The rate at which the daemon uses it in the cycle, were it alone, in Hz.
        error: Why it could not be probed; empty if it could.
    """

    driver: str
    identity: Identity | None = None
    capabilities: Capabilities | None = None
    units: ChannelUnits = ChannelUnits({}, {})
    in_force: Mapping[str, float] = {}
    readings: Mapping[str, float] = {}
    read: RoundTrip | None = None
    read_back: RoundTrip | None = None
    cost_ns: int = 0
    rate_hz: float = 0.0
    error: str = ""


def probe(
    config: "DaemonConfig", axes: Mapping[str, ChannelPair], clock: Clock
) -> dict[str, Probed]:
    """Look at each device of a stage; one that is absent leaves the others to their turn.

    Raises:
        RegistryError: If a driver cannot be loaded.
    """
    return {name: _probed(config, name, wiring_of(name, axes), clock) for name in config.devices}


def together_hz(found: Iterable[Probed]) -> float:
    """Return the rate at which all devices have their turn in the cycle, in Hz.

    At a higher one the daemon uses some of them behind a worker.
    """
    each = list(found)
    cost = sum(one.cost_ns for one in each)
    slowest_hz = min(one.rate_hz for one in each)
    return min(slowest_hz, IN_CYCLE_PART * NS_PER_S / cost) if cost else slowest_hz


def _used(units: ChannelUnits | None, wiring: Wiring) -> ChannelUnits:
    """Return the units of channels that are used."""
    if units is None:
        return ChannelUnits({}, {})
    return ChannelUnits(
        {name: units.inputs[name] for name in wiring.inputs if name in units.inputs},
        {name: units.outputs[name] for name in wiring.outputs if name in units.outputs},
    )


def _probed(config: "DaemonConfig", name: str, wiring: Wiring, clock: Clock) -> Probed:
    device = config.devices[name]
    plugin = registry.load(device.driver)
    create = plugin.create
    found = Probed(device.driver, units=_used(plugin.channels(device.options), wiring))
    try:
        with _open(create(device.options, wiring, config.seed)) as (whole, identity):
            found = found._replace(identity=identity, capabilities=whole.capabilities())
            if isinstance(whole, Amplifier) and wiring.outputs:
                found = _look_at_outputs(found, whole, clock)
        if wiring.inputs:
            alone = Wiring(wiring.inputs, ())
            with _open(create(device.options, alone, config.seed)) as (inputs, _):
                inputs.activate(clock.now_ns())
                if isinstance(inputs, Sensor):
                    found = _look_at_inputs(found, inputs, clock)
    except DeviceError as error:
        return found._replace(error=str(error))
    trips = [trip for trip in (found.read, found.read_back) if trip is not None]
    if any(trip.failed_pct == ALL_PCT for trip in trips):
        return found._replace(
            error="it is there, but tells nothing that can be used: wrong driver?"
        )
    return _rated(found)


@contextmanager
def _open(device: Device) -> "Iterator[tuple[Device, Identity]]":
    try:
        yield device, device.open()
    finally:
        device.close()


def _look_at_outputs(found: Probed, device: Amplifier, clock: Clock) -> Probed:
    able = device.capabilities()
    if not able.read_back:
        return found
    told = dict(zip(able.outputs, device.read_back(clock.now_ns()), strict=True))

    def exchange(now_ns: int) -> bool:
        return all(value - value == 0.0 for value in device.read_back(now_ns))

    return found._replace(in_force=told, read_back=_round_trip(exchange, clock))


def _look_at_inputs(found: Probed, device: Sensor, clock: Clock) -> Probed:
    names = device.capabilities().inputs

    def exchange(now_ns: int) -> bool:
        return all(sample.valid for sample in device.read(now_ns))

    trip = _round_trip(exchange, clock)
    samples = device.read(clock.now_ns())
    readings = {
        name: sample.position_um if sample.valid else float("nan")
        for name, sample in zip(names, samples, strict=True)
    }
    return found._replace(readings=readings, read=trip)


def _round_trip(exchange: Callable[[int], bool], clock: Clock) -> RoundTrip:
    took_us, failed = [], 0
    for _ in range(EXCHANGES):
        begin_ns = clock.now_ns()
        failed += not exchange(begin_ns)
        took_us.append((clock.now_ns() - begin_ns) / 1e3)
    took_us.sort()
    last = len(took_us) - 1
    p50, p90, p99 = (took_us[round(part * last)] for part in (0.5, 0.9, 0.99))
    return RoundTrip(p50, p90, p99, 100.0 * failed / EXCHANGES)


def _rated(found: Probed) -> Probed:
    """Add what its exchanges take of a cycle, and the rate that this allows, as the daemon does."""
    able = found.capabilities
    if able is None:
        return found
    cost = cost_ns(able, _of_a_cycle(found))
    most_hz = able.max_rate_hz
    rate_hz = min(most_hz, IN_CYCLE_PART * NS_PER_S / cost) if cost else most_hz
    return found._replace(cost_ns=cost, rate_hz=rate_hz)


def _of_a_cycle(found: Probed) -> RoundTrips:
    """Return how long reading and reading back take together; a write, as the longer of the two."""
    trips = [trip for trip in (found.read, found.read_back) if trip is not None]

    def ns(took_us: Iterable[float]) -> list[int]:
        return [round(1000 * each_us) for each_us in took_us]

    medians, p90s = ns(trip.median_us for trip in trips), ns(trip.p90_us for trip in trips)
    return RoundTrips(
        sum(medians),
        sum(p90s),
        sum(ns(trip.p99_us for trip in trips)),
        max(p90s, default=0),
        max(medians, default=0),
    )
