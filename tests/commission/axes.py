"""A manually driven axis of the simulated rig, on a simulated clock."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import nan
from pathlib import Path
from typing import Any

from piezod.commission.output import Output
from piezod.commission.session import Session
from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.control.guard import Limits
from piezod.devices import registry
from piezod.devices.channels import Channels
from piezod.devices.interface import Device
from piezod.devices.wiring import construct, pairs_of
from piezod.testing.fake_clock import FakeClock

CONFIG = Path(__file__).parents[2] / "config" / "simulated.yaml"
T0_NS = 1_000_000_000


def configured(options: dict[str, Any] | None = None, seed: int = 1) -> DaemonConfig:
    """Return the shipped configuration with other options of its rig."""
    config = load_daemon(CONFIG, registry).model_copy(update={"rate_hz": 1000.0})
    model = registry.load("simulated").options_model
    rig = config.devices["rig"].model_copy(update={"options": model.model_validate(options or {})})
    return config.model_copy(update={"devices": {"rig": rig}, "seed": seed})


@contextmanager
def session(
    options: dict[str, Any] | None = None,
    *,
    rate_hz: float = 1000.0,
    seed: int = 1,
    wrap: Callable[[Device], Device] = lambda device: device,
    limits: Limits = Limits(0.0, 150.0, 20_000.0),  # noqa: B008 - it never changes
    last_v: float = nan,
) -> Iterator[Session]:
    """Open an axis for the duration of the block."""
    config = configured(options, seed)
    pairs, clock = pairs_of(config.axes), FakeClock(T0_NS)
    made = construct(config.devices, pairs, seed)
    channels = Channels({name: wrap(device) for name, device in made.items()}, pairs)
    channels.open()
    try:
        channels.activate(clock.now_ns())
        clock.spend_ns(2_000_000_000)
        output = Output(channels, limits.read_back_tolerance_v, clock, last_v)
        yield Session(channels, output, limits, rate_hz, 50.0, clock)
    finally:
        channels.close()


def resting_at(drive_v: float) -> Callable[[Device], Device]:
    """Return a wrapper for a rig whose initial voltage is not 0 V."""

    def left(device: Device) -> Device:
        activate = device.activate

        def activating(now_ns: int) -> None:
            activate(now_ns)
            device.write([drive_v], now_ns)  # type: ignore[attr-defined] # the rig is both
            device.read_back(now_ns + 1_000_000_000)  # type: ignore[attr-defined] # likewise

        device.activate = activating  # type: ignore[method-assign] # of this one
        return device

    return left
