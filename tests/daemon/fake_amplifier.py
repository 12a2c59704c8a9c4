"""An amplifier with every fault that a ramp-down may meet."""

from collections.abc import Callable, Sequence
from math import inf, nan
from typing import Any

from piezod.config.daemon import DaemonConfig
from piezod.config.fields import ConfigModel, Context
from piezod.config.validate import validate
from piezod.config.yaml_loader import parse_yaml
from piezod.devices import registry
from piezod.devices.interface import Capabilities, Device, DriverPlugin, Identity, Wiring
from piezod.errors import DeviceUnavailableError

AXIS = """
  {name}:
    amplifier: {amplifier}
    sensor: {amplifier}
    limits: {{drive_min_v: -20, drive_max_v: 120, slew_v_per_s: 1000, rest_v: 0}}
    command_range_um: [0, 10]
    safety: {{safe_v: {safe_v}, ramp_v_per_s: 50}}
"""


class FakeAmplifier:
    """Applies every voltage at once.

    Attributes:
        drive_v: Voltage of each axis.
        writes: Instant and voltages of each accepted write.
        reads_back: Whether it can read back.
        silent: Whether it reads back NaN.
        refuses: Whether it refuses every write.
        stuck: Whether it accepts writes without effect.
        absent: How often it cannot be opened.
        wrong: Exception that its driver raises when it is opened.
        closed: Whether it was closed.
        activated: Whether it was activated.
        highest_v: Highest voltage that it accepts.
        watchdog: Whether it has a watchdog.
        holds: Whether it holds its output when it is closed; if not, that goes to 0 V.
        stuck_until_ns: Instant until which it accepts writes without effect; then the last one
            takes effect.
        follows_every_ns: Interval at which it obeys the last write; 0 obeys at once.
        silent_until_ns: Instant until which it reads back NaN.
        drops_at_v: Voltage below which its first axis drops out, once.
        steps_v: Distance of each accepted write from the voltage in force before it.
        read_ns: Instant of the last read-back.
    """

    def __init__(self, axes: tuple[str, ...], drive_v: float = 75.0) -> None:
        self.axes = axes
        self.drive_v = [drive_v] * len(axes)
        self.writes: list[tuple[int, list[float]]] = []
        self.reads_back = True
        self.silent = self.refuses = self.stuck = self.closed = False
        self.activated, self.highest_v = False, inf
        self.absent = 0
        self.wrong: Exception | None = None
        self.watchdog, self.stuck_until_ns, self.read_ns = False, 0, 0
        self.steps_v: list[float] = []
        self._waiting_v: list[float] = []
        self.drops_at_v, self.holds = -inf, True
        self.follows_every_ns = self.silent_until_ns = 0

    def open(self) -> Identity:
        if self.wrong:
            raise self.wrong
        if self.absent:
            self.absent -= 1
            raise DeviceUnavailableError("it is away")
        return Identity("piezod", "fake", "0", "0")

    def capabilities(self) -> Capabilities:
        return Capabilities(
            self.axes, self.axes, self.reads_back, 1e3, holds=self.holds, watchdog=self.watchdog
        )

    def activate(self, now_ns: int) -> None:  # noqa: ARG002 - the interface's
        self.activated = True

    def deactivate(self, now_ns: int) -> None:
        """Hold."""

    def close(self) -> None:
        self.closed = True
        if not self.holds:
            self.drive_v = [0.0] * len(self.axes)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        if self.refuses or max(drive_v) > self.highest_v:
            return False
        self.steps_v += [abs(a - b) for a, b in zip(drive_v, self.drive_v, strict=True)]
        self.writes.append((now_ns, list(drive_v)))
        self._waiting_v = list(drive_v)
        self._obey(now_ns)
        return True

    def _obey(self, now_ns: int) -> None:
        if self._waiting_v and not self.stuck and now_ns >= self.stuck_until_ns:
            self.stuck_until_ns = now_ns + self.follows_every_ns
            self.drive_v, self._waiting_v = self._waiting_v, []
            if self.drive_v[0] < self.drops_at_v:
                self.drive_v, self.drops_at_v = [0.0, *self.drive_v[1:]], -inf

    def read_back(self, now_ns: int) -> Sequence[float]:
        self.read_ns = now_ns
        self._obey(now_ns)
        silent = self.silent or now_ns < self.silent_until_ns
        return [nan] * len(self.axes) if silent else self.drive_v


class NoOptions(ConfigModel):
    """A driver without options."""


def stage_of(axes: dict[str, tuple[str, float]]) -> DaemonConfig:
    """Return the configuration of a stage, from the amplifier and the safe voltage of each axis."""
    devices = "".join(f"\n  {name}: {{driver: fake}}" for name in {a for a, _ in axes.values()})
    text = "".join(
        AXIS.format(name=name, amplifier=amplifier, safe_v=safe_v)
        for name, (amplifier, safe_v) in axes.items()
    )
    document = parse_yaml(f"rate_hz: 1000\ndevices:{devices}\naxes:{text}", "fake.yaml")
    return validate(document, DaemonConfig, Context(drivers=registry))


def plugin_of(create: Callable[[tuple[str, ...]], Device]) -> DriverPlugin[Any]:
    """Return a driver that constructs the devices of a test."""

    def make(_options: NoOptions, wiring: Wiring, _seed: int) -> Device:
        return create(wiring.outputs)

    return DriverPlugin("fake", "a fake", NoOptions, make, confirmed_on_hardware=False)
