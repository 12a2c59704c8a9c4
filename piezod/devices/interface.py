"""The interface that every driver implements.

A device goes through these steps, in this order::

    construct ──► open ──► activate ──► read, write, read_back … ──► deactivate ──► close
    no I/O                              once per cycle, in the loop

- Constructing a device only stores its options. `open` sends the first byte.
- Between `open` and `activate`, and after `deactivate`, the outputs are at rest, or they hold their
  voltage if `Capabilities.holds`. `write` is refused then and changes nothing. While the device is
  open, `capabilities` and `read_back` answer.
- `deactivate` and `close` may be called at any time and any number of times. They always leave the
  outputs safe, even after a failure. `close` deactivates first.
- No method reads a clock. `now_ns` is an instant on the caller's monotonic clock; it never
  decreases from call to call.
- Only `read`, `write`, `read_back` and the optional methods marked real-time safe are called in the
  loop. They allocate nothing but their result. They wait no longer than one exchange with the
  device. They report a fault as a value: an invalid sample or a refused write. They raise
  `DeviceError` only if the caller broke the order above, which is an error in the program and not a
  fault of the device.
- One thread at a time uses a device.
- A device serves the channels of its `Wiring`: inputs are read, outputs are driven. A device
  without inputs is no sensor, a device without outputs is no amplifier; many devices are both.
- A device that is both may offer one exchange for both, `Exchanges`.

A channel reads or drives values in its own unit, which the driver reports. The configuration of the
channel calibrates them to µm and V (`devices.calibration`). A simulated device may also implement
`KnowsTruth`; a real device cannot know the true displacement.
"""

from __future__ import annotations

import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Generic, NamedTuple, Protocol, Self, TypeVar, runtime_checkable

from piezod.config.faults import Fault

if typing.TYPE_CHECKING:
    from pydantic import BaseModel

OptionsT = TypeVar("OptionsT", bound="BaseModel")

UNKNOWN: Final = "unknown"
NOT_TOLD: Final = "not told"
"""Parts of an identity that the device does not report, or whose reply says nothing."""


class Identity(NamedTuple):
    """Identity that a device reports; texts as the device gives them, none of them empty.

    A part is `UNKNOWN` or `NOT_TOLD` if the device does not report it, or does not report it while
    only its outputs are used.
    """

    maker: str
    model: str
    serial: str
    firmware: str


def is_same(found: Identity, known: Identity) -> bool:
    """Return whether maker, model and serial number of two identities agree.

    A part that one of them does not report counts as equal. The firmware is not compared, because
    it can be updated.
    """
    return all(
        a == b or not {a, b}.isdisjoint({UNKNOWN, NOT_TOLD})
        for a, b in zip(found[:3], known[:3], strict=True)
    )


class Wiring(NamedTuple):
    """Channels of a device that a configuration uses; each name is unique on its side."""

    #: Names of the channels to read, in the order of every sequence of samples.
    inputs: tuple[str, ...]
    #: Names of the channels to drive, in the order of every sequence of values.
    outputs: tuple[str, ...]

    @classmethod
    def both(cls, channels: Iterable[str]) -> Self:
        """Return the wiring that reads and drives every channel."""
        names = tuple(channels)
        return cls(names, names)

    @property
    def channels(self) -> tuple[str, ...]:
        """Every channel once: the inputs, then the outputs that are not inputs."""
        return tuple(dict.fromkeys((*self.inputs, *self.outputs)))


class ChannelUnits(NamedTuple):
    """Channels of a device, each with the unit of its values."""

    #: Unit of each input by its name: "µm" if a sample is a displacement; otherwise the unit of the
    #: value to calibrate ("V", "%").
    inputs: Mapping[str, str]
    #: Unit of each output by its name: "V" for the voltage at the actuator or of a converter.
    outputs: Mapping[str, str]


class Capabilities(NamedTuple):
    """Capabilities of an open device."""

    #: Names of the channels to read, in the order of every sequence of samples.
    inputs: tuple[str, ...]
    #: Names of the channels to drive, in the order of every sequence of values.
    outputs: tuple[str, ...]
    #: Whether `read_back` asks the device. If not, it returns the last written value.
    read_back: bool
    max_rate_hz: float  #: Highest loop rate that the device supports, in Hz.
    #: Whether the outputs hold their value when the device is deactivated or closed, and do not go
    #: to rest. They must be brought to a safe voltage first; after the death of the loop process
    #: `piezod safe` does that.
    holds: bool = False
    #: Whether the stage is at rest, with an empty hysteresis memory, whenever the device is opened.
    #: True only for devices that exist in this process alone.
    opens_relaxed: bool = False
    enables: bool = False  #: Whether `activate` enables the outputs and `deactivate` disables them.
    soft_disable: bool = False  #: Whether a disabled output ramps down slowly.
    #: Whether the device itself makes its outputs safe if its host falls silent.
    watchdog: bool = False
    quality: bool = (
        False  #: Whether samples carry a quality, so that a bad sample is marked as bad.
    )
    #: Delay between the write of a value and its effect and read-back, in ns, if the loop does not
    #: wait for it.
    lag_ns: int = 0
    #: Lowest and highest value of each output; empty if the device does not report them.
    ranges: tuple[tuple[float, float], ...] = ()
    #: Whether the device reports, before it accepts another write, that it was switched off and on
    #: again or has fallen back to its own safe state. This also covers a lost connection and a
    #: device that was opened again. For any other device the last written value may no longer be in
    #: force after an absence, unless it is read back.
    tells_restart: bool = False


class Sample(NamedTuple):
    """One measured displacement."""

    t_ns: int  #: Instant of the sample, never later than the call that read it.
    #: Displacement in µm, or the channel's value in its own unit before calibration; must not be
    #: used unless `valid`.
    position_um: float
    valid: bool  #: False if the device reports a fault, saturation, or nothing at all.


@runtime_checkable
class Device(Protocol):
    """Common part of sensors and amplifiers: the life cycle described in the module docstring."""

    def open(self) -> Identity:
        """Connect to the device and return its identity; outputs stay as they are or become safe.

        Raises:
            DeviceUnavailableError: If it is absent, held by another program, or does not answer.
            DeviceError: If it is already open, or its answer violates its protocol.
        """
        ...

    def capabilities(self) -> Capabilities:
        """Return the capabilities; they stay the same until the device is closed.

        Raises:
            DeviceError: If the device is not open.
        """
        ...

    def activate(self, now_ns: int) -> None:
        """Prepare the device for cyclic calls, with its outputs at rest.

        Raises:
            DeviceError: If the device is not open.
        """
        ...

    def deactivate(self, now_ns: int) -> None:
        """Bring the outputs to rest, or hold them, and refuse writes from now on. Never raises."""
        ...

    def close(self) -> None:
        """Make the outputs safe and release the device. Never raises."""
        ...


@runtime_checkable
class Sensor(Device, Protocol):
    """A device that measures displacement."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return one sample of each input, in the order of `Capabilities.inputs`. Real-time safe.

        Raises:
            DeviceError: If the device is not active.
        """
        ...


@runtime_checkable
class Amplifier(Device, Protocol):
    """A device that drives the actuators."""

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set every output, in the order of `Capabilities.outputs`. Real-time safe.

        Values are in the unit of each output. The write is refused as a whole, and the outputs
        stay, if a value is not finite or out of range, if the number of values is wrong, or if the
        device is not active.

        Returns:
            True if the device accepted the values, False if it refused them.
        """
        ...

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the read-back value of each output. Real-time safe.

        The order is that of `Capabilities.outputs`; a value is NaN if it is unknown.

        Raises:
            DeviceError: If the device is not open.
        """
        ...


@runtime_checkable
class Exchanges(Protocol):
    """A device that writes values and reads samples in one exchange, which halves the bus time."""

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Do `Amplifier.write` and `Sensor.read` in one exchange. Real-time safe.

        Returns:
            Whether the values were accepted, and a sample of each input.
        """
        ...


@runtime_checkable
class KnowsTruth(Protocol):
    """A simulated sensor that knows the true displacement, from which its error can be computed."""

    def true_position_um(self, now_ns: int) -> Sequence[float]:
        """Return the true displacement of each axis from rest, in µm. Real-time safe.

        The order is that of `Capabilities.inputs`. This is the displacement of the mechanics,
        before the sensor with its noise, calibration, filter and delay. Call it after the `read` of
        the same instant. It does not change the simulation: samples are the same to the bit with
        and without it.

        Raises:
            DeviceError: If the device is not active.
        """
        ...


def any_channel(_options: object) -> None:
    """Return None: the driver accepts any channel name."""


def faults(ids: str) -> frozenset[str]:
    """Return the faults of `docs/faults.md` with these ids, which spaces separate, such as "A1 B3".

    Raises:
        ValueError: If there is no such fault.
    """
    return frozenset(map(Fault, ids.split()))


@dataclass(frozen=True, slots=True)
class DriverPlugin(Generic[OptionsT]):
    """Description of a driver, exported by its module as `PLUGIN` for `piezod.devices.registry`."""

    name: str  #: Name that configurations use; the same as the name of its entry point.
    summary: str  #: One line for lists: the devices that it drives.
    #: Model that validates `options:` of a device in a configuration. Options have defaults
    #: wherever a default makes sense.
    options_model: type[OptionsT]
    #: Constructs a device, without I/O, from its options, the used channels, and a seed for its
    #: random numbers.
    create: Callable[[OptionsT, Wiring, int], Device]
    confirmed_on_hardware: bool  #: Whether it has been confirmed on the real device.
    #: Returns the channels of a device with these options; None if any name is accepted.
    channels: Callable[[OptionsT], ChannelUnits | None] = any_channel
    #: Ids of the faults of bus, amplifier and sensor that it can detect; see `faults`.
    sees: frozenset[str] = frozenset()
