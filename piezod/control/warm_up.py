"""Runs every path of the cycle once before it counts, so that everything is compiled by then."""

from collections.abc import Sequence
from math import nan

import numpy as np

from piezod.config.daemon import DaemonConfig
from piezod.config.modes import Mode
from piezod.config.waveforms.combined import WaveformConfig
from piezod.config.waveforms.shapes import Sine
from piezod.control.assembly import assemble
from piezod.control.controller import StageController
from piezod.control.law.creep import AT_REST
from piezod.control.law.kernels import new_kernel
from piezod.control.watch.loop import CycleTiming
from piezod.devices.interface import Capabilities, Identity, Sample
from piezod.devices.status import NO_FLAGS, Flags
from piezod.hysteresis import RLSIdentifier, StopForm, SurfaceForm, SurfaceIdentifier
from piezod.messages import requests
from piezod.units import NS_PER_S

_CYCLES = 50
"""Cycles after each request: enough for every state to be reached."""


class IdealDevices:
    """Devices that accept every write, with a stage that moves in proportion."""

    def __init__(self, config: DaemonConfig) -> None:
        self._axes = tuple(config.axes)
        self._rest_v = [axis.limits.rest_v for axis in config.axes.values()]
        self._drive_v: Sequence[float] = self._rest_v
        self.um_per_v = [0.1] * len(self._axes)
        """Displacement of each axis over its drive, in µm/V."""

    def open(self) -> Identity:
        """Return a made-up identity."""
        return Identity("piezod", "warm-up", "0", "0")

    def capabilities(self) -> Capabilities:
        """Return that they can do all that a mode needs."""
        return Capabilities(
            self._axes, self._axes, read_back=True, max_rate_hz=1e6, opens_relaxed=True
        )

    def activate(self, now_ns: int) -> None:
        """Do nothing."""

    def deactivate(self, now_ns: int) -> None:  # noqa: ARG002 - asked for by Device
        """Go to rest."""
        self._drive_v = self._rest_v

    def close(self) -> None:
        """Do nothing."""

    def zero(self, zero_um: Sequence[float], true_zero_um: Sequence[float]) -> None:
        """Do nothing."""

    def forget(self) -> None:
        """Do nothing."""

    def commands(self) -> Sequence[Sample]:
        """Return that nothing commands the axes."""
        return [Sample(0, nan, False)] * len(self._axes)

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return positions in proportion to the drives."""
        return [
            Sample(now_ns, um_per_v * (drive_v - rest_v), True)
            for um_per_v, drive_v, rest_v in zip(
                self.um_per_v, self._drive_v, self._rest_v, strict=True
            )
        ]

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:  # noqa: ARG002 - the same
        """Take voltages."""
        self._drive_v = list(drive_v)
        return True

    def set_lines(self, now_ns: int, *, at_rest: bool) -> None:
        """Do nothing."""

    def read_back(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the same
        """Return the last write."""
        return self._drive_v

    def watchdogs(self) -> Sequence[bool]:
        """Return that there is none."""
        return [False] * len(self._axes)

    def reads_back(self) -> Sequence[bool]:
        """Return that all do."""
        return [True] * len(self._axes)

    def read_back_age_ns(self, now_ns: int) -> Sequence[int]:  # noqa: ARG002 - the same
        """Return that each read-back is of this cycle."""
        return [0] * len(self._axes)

    def status(self, now_ns: int) -> Sequence[Flags]:  # noqa: ARG002 - the same
        """Return no flags."""
        return [NO_FLAGS] * (2 * len(self._axes))


def _warm_forms() -> None:
    """Run the kernels of both forms of a model: a stage may adopt either while it runs."""
    stops, surface = StopForm.even(2), SurfaceForm()
    identifiers = (
        (stops, RLSIdentifier(stops.bank, stops.straight_line())),
        (surface, SurfaceIdentifier(surface.straight_line(), surface)),
    )
    levels = np.array([0.0, 0.5, 1.0])
    for form, identifier in identifiers:
        weights = form.straight_line()
        kernel = new_kernel(form, weights.copy(), AT_REST)
        for level in (0.2, 0.8, 0.4):
            kernel.step(weights, 0.5, 1.0, level, 1.0, 0.0, 0.0, 1.0)
            identifier.step(level, level)
        identifier.predict(weights, 0.0, 0.0)
        form.smallest_slope(weights)
        past = form.past(weights)
        past.follow(levels)
        past.step(0.5)
        form.widest_loop(weights, levels)
        form.position_range(weights, levels)
        form.loop(levels).of(identifier)


def waves_over_the_range(
    config: DaemonConfig, controller: StageController
) -> dict[str, WaveformConfig]:
    """Return a sine of 1 Hz over the range of each axis."""
    return {
        name: Sine(
            kind="sine",
            low=axis.motion_limits.low_um,
            high=axis.motion_limits.high_um,
            frequency_hz=1.0,
        )
        for name, axis in zip(config.axes, controller.axes, strict=True)
    }


def _user_path(config: DaemonConfig) -> Sequence[requests.Path]:
    """Return a movement of the user axes, if there are any, to the middle of their ranges."""
    middle = {name: sum(axis.range) / 2 for name, axis in config.user_axes.items()}
    return (requests.Path(points=(middle,)),) if middle else ()


def warm_up(config: DaemonConfig) -> None:
    """Run a stage of this configuration through all states and modes, without its devices.

    Raises:
        ConfigError: If a model file cannot be used.
        DataError: If a model does not hold at the rest voltage.
        ModelError: If a gain is not safe.
    """
    _warm_forms()
    devices = IdealDevices(config)
    controller = assemble(config, devices, devices.capabilities())
    period_ns, t_ns = round(NS_PER_S / config.rate_hz), NS_PER_S
    waves = waves_over_the_range(config, controller)
    for request in (
        None,
        requests.Zero(),
        requests.Arm(),
        *(requests.SelectMode(mode=mode) for mode in Mode),
        *_user_path(config),
        requests.Wave(command_um=waves, duration_s=1.0),
        requests.Hold(),
        requests.Resume(),
        requests.Stop(),
    ):
        if request is not None:
            controller.execute(request, t_ns)
        for _ in range(_CYCLES):
            t_ns += period_ns
            controller.cycle(t_ns, CycleTiming(0, 0, 0, 0, 0))
            for i in range(len(waves)):
                controller.learned(i)
        controller.take_events()
