"""The interface that every driver implements.

A device lives through these steps, in this order::

    construct ──► open ──► activate ──► read, write, read_back … ──► deactivate ──► close
    no I/O                              once per cycle, in the loop

- Constructing a device only stores its options. The first byte on a wire is sent by `open`.
- Between `open` and `activate`, and after `deactivate`, the outputs rest, or stay as they are where
  `Capabilities.holds`: `write` is refused and changes nothing. As long as the device is open,
  `capabilities` and `read_back` answer.
- `deactivate` and `close` may be called at any time, any number of times, and always leave the
  outputs safe; `close` deactivates first. If they cannot be graceful, they are safe nevertheless.
- Nothing here reads a clock. `now_ns` is an instant on the caller's monotonic clock; from call to
  call it never goes back.
- Only `read`, `write` and `read_back` are called in the loop. They do not allocate more than their
  answer, do not wait longer than one exchange with the device takes, and report a fault as a value:
  an invalid sample or a refused write. They raise `DeviceError` only where the caller broke the
  order above, which is a mistake in the program and not a fault of the device.
- A device is used by one thread at a time.

- A device is asked for some of its channels, its `Wiring`: inputs are read, outputs are driven. One
  that has no inputs is no sensor, one that has no outputs no amplifier; many are both.
- An amplifier and sensor in one may offer one exchange for both, `Exchanges`.

What a channel reads or drives is in its own unit, as its driver says; calibration to µm and V is
the channel's, in the configuration (`devices.calibration`). A simulated device may offer one call
more, `KnowsTruth`: a real one cannot know what it measures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import (
    TYPE_CHECKING,
    Final,
    Generic,
    NamedTuple,
    Protocol,
    Self,
    TypeVar,
    runtime_checkable,
)

if TYPE_CHECKING:
    from pydantic import BaseModel

OptionsT = TypeVar("OptionsT", bound="BaseModel")

_NOT_TOLD: Final = frozenset({"unknown", "not told"})


class Identity(NamedTuple):
    """Who a device says it is; texts as the device gives them, none of them empty.

    What it does not tell, or not when only its outputs are asked for, is "unknown" or "not told".
    """

    maker: str
    model: str
    serial: str
    firmware: str


def is_same(found: Identity, known: Identity) -> bool:
    """Tell whether nothing speaks against two being one, by maker, model and serial number."""
    return all(
        a == b or not _NOT_TOLD.isdisjoint({a, b})
        for a, b in zip(found[:3], known[:3], strict=True)
    )


class Wiring(NamedTuple):
    """The channels of a device that a configuration uses; no name twice among either.

    Attributes:
        inputs: Names of the channels that are read, in the order of every sequence of samples.
        outputs: Names of the channels that are driven, in the order of every sequence of values.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @classmethod
    def both(cls, channels: Iterable[str]) -> Self:
        """Return the wiring in which every channel is read and driven."""
        names = tuple(channels)
        return cls(names, names)

    @property
    def channels(self) -> tuple[str, ...]:
        """Every channel once: the inputs, then the outputs that are no inputs."""
        return tuple(dict.fromkeys((*self.inputs, *self.outputs)))


class ChannelUnits(NamedTuple):
    """The channels that a device has, each with the unit of its values.

    Attributes:
        inputs: Unit of each input by its name: "µm" where a sample is a displacement, else as what
            has to be calibrated is called ("V", "%").
        outputs: Unit of each output by its name: "V" for the voltage of the actuator or of a
            converter.
    """

    inputs: Mapping[str, str]
    outputs: Mapping[str, str]


class Capabilities(NamedTuple):
    """What an open device can do.

    Attributes:
        inputs: Names of the channels that it reads, in the order of every sequence of samples.
        outputs: Names of the channels that it drives, in the order of every sequence of values.
        read_back: Whether `read_back` asks the device. Where it does not, `read_back` gives the
            value written last.
        max_rate_hz: The fastest loop that the device can follow.
        holds: Whether the outputs stay as they are when the device is deactivated or closed, and do
            not go to rest. They must be brought to a safe voltage before; after the death of the
            process that drove them it is `piezod safe` that does it.
        opens_relaxed: Whether the stage is at rest, with nothing to remember, whenever the device
            is opened: one that exists in this process only.
        enables: Whether outputs are enabled by `activate` and disabled by `deactivate`.
        soft_disable: Whether an output that is disabled comes down gently.
        watchdog: Whether the device itself makes its outputs safe when its host falls silent.
        quality: Whether samples come with a quality, so that a bad one is known to be bad.
        lag_ns: How much later than it was written a value comes into force and is read back, where
            the loop does not wait for it.
        ranges: Lowest and highest value that each output can be set to; empty where the device does
            not tell.
        tells_restart: Whether the device tells that it was switched off and on again, or has fallen
            back to its own safe state, before it takes another write; also where the connection was
            lost and the device opened again. What was written last to any other one is not known to
            be in force after it has been away, unless it is read back.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    read_back: bool
    max_rate_hz: float
    holds: bool = False
    opens_relaxed: bool = False
    enables: bool = False
    soft_disable: bool = False
    watchdog: bool = False
    quality: bool = False
    lag_ns: int = 0
    ranges: tuple[tuple[float, float], ...] = ()
    tells_restart: bool = False


class Sample(NamedTuple):
    """One measured displacement.

    Attributes:
        t_ns: The instant the sample was taken, never later than the call that read it.
        position_um: Displacement in µm, or what the channel reads in its own unit before it is
            calibrated; not to be used unless `valid`.
        valid: False where the device reports a fault, saturation, or nothing at all.
    """

    t_ns: int
    position_um: float
    valid: bool


@runtime_checkable
class Device(Protocol):
    """What sensors and amplifiers have in common: the life-cycle at the top of this file."""

    def open(self) -> Identity:
        """Connect to the device and ask who it is; its outputs stay as they are or become safe.

        Raises:
            DeviceUnavailableError: If it is absent, held by somebody else, or does not answer.
            DeviceError: If it is already open, or answers something its protocol does not allow.
        """
        ...

    def capabilities(self) -> Capabilities:
        """Tell what the device can do; the answer stays the same until it is closed.

        Raises:
            DeviceError: If the device is not open.
        """
        ...

    def activate(self, now_ns: int) -> None:
        """Make the device ready for cyclic calls, its outputs at rest.

        Raises:
            DeviceError: If the device is not open.
        """
        ...

    def deactivate(self, now_ns: int) -> None:
        """Bring the outputs to rest, or hold them, and refuse writes from now on. Never raises."""
        ...

    def close(self) -> None:
        """Make the outputs safe and let go of the device. Never raises."""
        ...


@runtime_checkable
class Sensor(Device, Protocol):
    """A device that measures displacement."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take one sample of each input, in the order of `Capabilities.inputs`.

        May be called in the loop.

        Raises:
            DeviceError: If the device is not active.
        """
        ...


@runtime_checkable
class Amplifier(Device, Protocol):
    """A device that drives the actuators."""

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set the value of every output, in its unit and in the order of `Capabilities.outputs`.

        May be called in the loop. A value that is not finite or beyond what the device can drive, a
        wrong number of values, or a device that is not active: the write is refused as a whole and
        the outputs stay as they are.

        Returns:
            True if the device took the values, False if they were refused.
        """
        ...

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Tell what is now in force on each output, in the order of `Capabilities.outputs`.

        May be called in the loop.

        Raises:
            DeviceError: If the device is not open.
        """
        ...


@runtime_checkable
class Exchanges(Protocol):
    """A device that takes values and gives samples in one exchange, which halves the bus time."""

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Write as `Amplifier.write` does and read as `Sensor.read` does, in one exchange.

        May be called in the loop.

        Returns:
            Whether the values were taken, and a sample of each input.
        """
        ...


@runtime_checkable
class KnowsTruth(Protocol):
    """A simulated sensor that also knows what it measures, so that its own errors can be told."""

    def true_position_um(self, now_ns: int) -> Sequence[float]:
        """Tell how far each axis really is from rest, in µm, in the order of `Capabilities.inputs`.

        This is the displacement of the mechanics: before the sensor with its noise, calibration,
        filter and delay. May be called in the loop, after the `read` of the same instant, and
        disturbs nothing: samples are the same to the bit whether anybody asks or not.

        Raises:
            DeviceError: If the device is not active.
        """
        ...


def any_channel(_options: object) -> None:
    """Say that channels may be called as one likes."""


@dataclass(frozen=True, slots=True)
class DriverPlugin(Generic[OptionsT]):
    """What a driver's module exports as `PLUGIN` to be found by `piezod.devices.registry`.

    Attributes:
        name: The name under which configurations ask for it; the same as its entry point's.
        summary: One line for lists: which devices it drives.
        options_model: The model that validates `options:` of a device in a configuration. Options
            left out have defaults wherever a default makes sense.
        create: Constructs a device, without I/O, from its options, the channels that are used, and
            a seed for whatever is random in it.
        confirmed_on_hardware: Whether somebody has seen it drive the real device.
        channels: Tells which channels a device with these options has; None where any name will do.
        sees: Ids of the faults of bus, amplifier and sensor (`docs/faults.md`) that it can see.
    """

    name: str
    summary: str
    options_model: type[OptionsT]
    create: Callable[[OptionsT, Wiring, int], Device]
    confirmed_on_hardware: bool
    channels: Callable[[OptionsT], ChannelUnits | None] = any_channel
    sees: frozenset[str] = frozenset()
