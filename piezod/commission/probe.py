"""Inspection of the devices of a stage: identity, capabilities and speed, without driving.

Each device is opened twice. With all its channels it reports its identity and the values in force;
its outputs are not controlled. With its inputs alone it is activated and read.
"""

from collections.abc import Callable, Container, Iterable, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final, NamedTuple

from piezod.daemon.clock import Clock
from piezod.daemon.loop.placement import IN_CYCLE_PART, RoundTrips, cost_ns
from piezod.devices import registry
from piezod.devices.bus.bus_device import BusDevice
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
"""Exchanges per device and kind: enough for a 99th percentile, and a few seconds at most."""
TRACED_EXCHANGES: Final = 3
"""Exchanges per device and kind if people look at their bytes."""
ALL_PCT: Final = 100.0


class RoundTrip(NamedTuple):
    """Duration of an exchange, in µs."""

    median_us: float  #: Median.
    p90_us: float  #: 90th percentile; it determines the rate.
    p99_us: float  #: 99th percentile.
    failed_pct: float  #: Share of exchanges without a result, in %.


class Probed(NamedTuple):
    """Result for one device."""

    driver: str  #: Name of its driver.
    identity: Identity | None = None  #: Its identity; None if it could not be opened.
    capabilities: Capabilities | None = None  #: Its capabilities; None if it could not be opened.
    #: Unit of each used channel, if the driver reports it.
    units: ChannelUnits = ChannelUnits({}, {})
    in_force: Mapping[str, float] = {}  #: Value in force of each output, by name.
    readings: Mapping[str, float] = {}  #: Value of each input, by name; NaN for an invalid one.
    read: RoundTrip | None = None  #: Round trip of a read; None if it has no inputs.
    read_back: RoundTrip | None = None  #: Round trip of a read-back; None if it has none.
    cost_ns: int = 0  #: Duration of its exchanges in a cycle, in ns.
    #: Highest rate at which the daemon would use this device alone in the cycle, in Hz.
    rate_hz: float = 0.0
    error: str = ""  #: Why it could not be probed; empty if it could.


def probe(
    config: "DaemonConfig",
    axes: Mapping[str, ChannelPair],
    clock: Clock,
    exchanges: int = EXCHANGES,
) -> dict[str, Probed]:
    """Inspect each device of a stage; an absent device does not prevent the others.

    Raises:
        RegistryError: If a driver cannot be loaded.
    """
    return {
        name: _probed(config, name, wiring_of(name, axes, config.lines), Timing(clock, exchanges))
        for name in config.devices
    }


class Timing(NamedTuple):
    """How exchanges are timed."""

    clock: Clock  #: The clock.
    exchanges: int  #: Number of exchanges.


def together_hz(found: Iterable[Probed]) -> float:
    """Return the highest rate at which all devices fit into the cycle, in Hz.

    At a higher rate the daemon uses some of them behind a worker.
    """
    each = list(found)
    cost = sum(one.cost_ns for one in each)  # the loop uses them one after the other
    slowest_hz = min(one.rate_hz for one in each)
    return min(slowest_hz, IN_CYCLE_PART * NS_PER_S / cost) if cost else slowest_hz


def _used(units: ChannelUnits | None, wiring: Wiring) -> ChannelUnits:
    """Return the units of the used channels."""
    if units is None:
        return ChannelUnits({}, {})
    return ChannelUnits(
        {name: units.inputs[name] for name in wiring.inputs if name in units.inputs},
        {name: units.outputs[name] for name in wiring.outputs if name in units.outputs},
    )


def _probed(config: "DaemonConfig", name: str, wiring: Wiring, timing: Timing) -> Probed:
    device = config.devices[name]
    plugin = registry.load(device.driver)
    create = plugin.create
    found = Probed(device.driver, units=_used(plugin.channels(device.options), wiring))
    why = ""
    try:
        with _open(create(device.options, wiring, config.seed)) as (whole, identity):
            found = found._replace(identity=identity, capabilities=whole.capabilities())
            if isinstance(whole, Amplifier) and wiring.outputs:
                lines = {each.output for each in config.lines.values() if each.device == name}
                found = _look_at_outputs(found, whole, timing, lines)
            why = _last_fault(whole)
        if wiring.inputs:
            # Without outputs, activation cannot drive anything.
            alone = Wiring(wiring.inputs, ())
            with _open(create(device.options, alone, config.seed)) as (inputs, _):
                inputs.activate(timing.clock.now_ns())
                if isinstance(inputs, Sensor):
                    found = _look_at_inputs(found, inputs, timing)
                why = _last_fault(inputs) or why
    except DeviceError as error:
        return found._replace(error=str(error))
    trips = [trip for trip in (found.read, found.read_back) if trip is not None]
    # Only if all exchanges failed: a few lost replies do not make a device useless.
    if any(trip.failed_pct == ALL_PCT for trip in trips):
        what = f"the device answers, but gives no usable value{why and ' (' + why + ')'}"
        return found._replace(error=f"{what}: check its driver and options")
    return _rated(found)


def _last_fault(device: Device) -> str:
    """Return the text of the last failed exchange with a device on a wire."""
    return device.last_fault if isinstance(device, BusDevice) else ""


@contextmanager
def _open(device: Device) -> "Iterator[tuple[Device, Identity]]":
    try:
        yield device, device.open()
    finally:
        device.close()


def _look_at_outputs(
    found: Probed, device: Amplifier, timing: Timing, lines: Container[str | None]
) -> Probed:
    able = device.capabilities()
    if not able.read_back:
        return found
    in_force = dict(zip(able.outputs, device.read_back(timing.clock.now_ns()), strict=True))

    def exchange(now_ns: int) -> bool:
        values = zip(able.outputs, device.read_back(now_ns), strict=True)
        # Lines need no read-back. False for NaN.
        return all(value - value == 0.0 for name, value in values if name not in lines)

    return found._replace(in_force=in_force, read_back=_round_trip(exchange, timing))


def _look_at_inputs(found: Probed, device: Sensor, timing: Timing) -> Probed:
    names = device.capabilities().inputs

    def exchange(now_ns: int) -> bool:
        return all(sample.valid for sample in device.read(now_ns))

    trip = _round_trip(exchange, timing)
    samples = device.read(timing.clock.now_ns())
    readings = {
        name: sample.position_um if sample.valid else float("nan")
        for name, sample in zip(names, samples, strict=True)
    }
    return found._replace(readings=readings, read=trip)


def _round_trip(exchange: Callable[[int], bool], timing: Timing) -> RoundTrip:
    clock, exchanges = timing
    took_us, failed = [], 0
    for _ in range(exchanges):
        begin_ns = clock.now_ns()
        failed += not exchange(begin_ns)
        took_us.append((clock.now_ns() - begin_ns) / 1e3)
    took_us.sort()
    last = len(took_us) - 1
    p50, p90, p99 = (took_us[round(part * last)] for part in (0.5, 0.9, 0.99))
    return RoundTrip(p50, p90, p99, 100.0 * failed / exchanges)


def _rated(found: Probed) -> Probed:
    """Add the cost of its exchanges, and the rate that it allows, computed as in the daemon."""
    able = found.capabilities
    if able is None:
        return found
    cost = cost_ns(able, _of_a_cycle(found))
    most_hz = able.max_rate_hz
    rate_hz = min(most_hz, IN_CYCLE_PART * NS_PER_S / cost) if cost else most_hz
    return found._replace(cost_ns=cost, rate_hz=rate_hz)


def _of_a_cycle(found: Probed) -> RoundTrips:
    """Return the duration of read and read-back together; a write counts like the longer one."""
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
