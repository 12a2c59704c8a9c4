"""Errors of user axes on the simulated rig, in virtual time: `python -m benchmarks.user_axes`.

Two axes with 3 % coupling each way, before and after `piezod identify --coupling` of a record that
is made here; and a tip/tilt table. Errors are those of the true displacement.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from piezod.config.coupling_file import CouplingFile
from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Component, Multisine
from piezod.control.assembly import assemble
from piezod.control.watch.loop import CycleTiming
from piezod.coordinates.matrices import times
from piezod.devices import registry
from piezod.devices.channels import Channels
from piezod.devices.wiring import construct, pairs_of
from piezod.experiment.fit.coupling import couplings_in
from piezod.messages import requests as rq
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.reader import RecordedTelemetry
from piezod.units import NS_PER_S

CONFIG = Path(__file__).parents[1] / "config"
RATE_HZ = 1000.0
SLOW_HZ = 0.25
LAGS_S = (0.0, 0.0005, 0.005)
MIDDLE = {"x": 12.5, "y": 12.5}
POINTS = (
    {"z": 12.5},
    {"z": 8.0},
    {"z": 16.0},
    {"z": 12.5, "rx": 40.0},
    {"rx": -40.0},
    {"rx": 0.0, "ry": 60.0},
    {"ry": -60.0},
    {"z": 15.0, "rx": 30.0, "ry": 30.0},
)
_ON_TIME = CycleTiming(0, 0, 10_000, 0, 0)


@dataclass
class Trace:
    """Commands and true positions of the axes of one run, in their units; (n,) each by name."""

    command: dict[str, Any]
    true: dict[str, Any]
    position: dict[str, Any]
    in_force_v: dict[str, Any]

    def error(self, name: str) -> Any:
        """Return command minus true position."""
        return self.command[name] - self.true[name]


class VirtualRig:
    """A stage on its rig, armed at rest."""

    def __init__(self, config: DaemonConfig) -> None:
        self.config = config
        pairs = pairs_of(config.axes)
        self._channels = Channels(construct(config.devices, pairs, config.seed), pairs)
        self._channels.open()
        self._channels.activate(0)
        self._t_ns, self._period_ns = 0, round(NS_PER_S / config.rate_hz)
        self._controller = assemble(config, self._channels, self._channels.capabilities())
        self._zero_um = [0.0] * len(config.axes)
        self.run(0.5)
        self.ask(rq.Zero())
        self.run(0.5)
        self.ask(rq.Arm())
        self.run(0.1)

    def condition(self) -> None:
        """Swing over the whole range, rest, and count positions from there."""
        self.ask(rq.Condition())
        self.run(60.0)
        self.ask(rq.Stop())
        self.run(12.0)
        self.ask(rq.Zero())
        self._zero_um = list(self._channels.true_position_um(self._t_ns))
        self.run(1.0)
        self.ask(rq.Arm())
        self.run(0.1)

    def ask(self, request: rq.Request) -> float:
        """Send a request; return how long the movement takes, in s."""
        answer = self._controller.execute(request, self._t_ns)
        if not answer.accepted:
            raise SystemExit(answer.why)
        return answer.duration_s

    def run(self, duration_s: float) -> Trace:
        """Run for a while; return what the axes did."""
        names = self.config.shown_axes
        kept: list[list[list[float]]] = []
        frame = None if self.config.transform is None else self.config.transform.frame()
        for _ in range(round(duration_s * self.config.rate_hz)):
            self._t_ns += self._period_ns
            record = self._controller.cycle(self._t_ns, _ON_TIME)
            true_um = self._channels.true_position_um(self._t_ns)
            true = [um - zero for um, zero in zip(true_um, self._zero_um, strict=True)]
            if frame is not None:
                true += frame.user(times(frame.from_sensors, true))
            each = zip(record.axes, true, strict=True)
            kept.append([[a.command_um, um, a.position_um, a.in_force_v] for a, um in each])
        columns = np.array(kept)
        return Trace(*({n: columns[:, i, k] for i, n in enumerate(names)} for k in range(4)))


def sine(low: float, high: float, phase_deg: float = 0.0, hz: float = SLOW_HZ) -> Multisine:
    """Return a sine, by default a slow one."""
    part = Component(amplitude=(high - low) / 2, frequency_hz=hz, phase_deg=phase_deg)
    return Multisine(kind="multisine", low=low, components=(part,))


def swung(
    config: DaemonConfig,
    start: Mapping[str, float],
    waves: Mapping[str, Multisine],
    *,
    conditioned: bool = False,
) -> Trace:
    """Return the second period of waves that begin at a point."""
    rig = VirtualRig(config)
    if conditioned:
        rig.condition()
    if config.transform:
        rig.run(rig.ask(rq.Path(points=({**start},))) + 1.0)
    lasts_s = rig.ask(rq.Wave(command_um={**waves}, duration_s=2 / SLOW_HZ))
    return Trace(
        *(
            {name: each[-round(RATE_HZ / SLOW_HZ) :] for name, each in of.items()}
            for of in vars(rig.run(lasts_s)).values()
        )
    )


def coupling_of(config: DaemonConfig, hz: float = SLOW_HZ) -> CouplingFile:
    """Return the coupling that `piezod identify --coupling` finds, from a record of a stage."""
    rig = VirtualRig(config.model_copy(update={"transform": None}))
    parts = []
    for name in config.axes:
        wave = sine(2.0, 24.0, hz=hz)
        lasts_s = rig.ask(rq.Wave(command_um={name: wave}, duration_s=2 / SLOW_HZ))
        parts.append(rig.run(lasts_s + 0.5))
    columns = {
        name: {
            key: np.concatenate([getattr(part, of)[name] for part in parts])
            for key, of in (("position_um", "position"), ("in_force_v", "in_force_v"))
        }
        for name in config.axes
    }
    t_s = np.arange(columns[next(iter(columns))]["position_um"].size) / RATE_HZ
    header = TelemetryHeader("", tuple(config.axes), RATE_HZ, "", 0)
    record = RecordedTelemetry(header, 0, np.zeros((0, 2), np.int64), {"t_s": t_s}, columns, {})
    fitted = couplings_in(record, Path("virtual"))
    for pair in fitted.pairs:
        print(
            f"identified: {pair.moving} moves {pair.resting} by {100 * pair.share:.3f} ± "
            f"{100 * pair.uncertainty:.3f} %, later by {1e3 * pair.lag_s:.2f} ± "
            f"{1e3 * pair.lag_uncertainty_s:.2f} ms"
        )
    return fitted.file("now")


def at_rate(path: Path) -> DaemonConfig:
    """Return an example at the rate of the benchmark."""
    return load_daemon(path, registry).model_copy(update={"rate_hz": RATE_HZ})


def two_axes() -> None:
    """Print the errors of two coupled axes, and of a circle."""
    config = at_rate(CONFIG / "coupled.yaml")
    if (transform := config.transform) is None:
        raise SystemExit("coupled.yaml has no transform")
    for coupling in (None, coupling_of(config)):
        one = transform.model_copy(update={"coupling": coupling})
        used = config.model_copy(update={"transform": one})
        what = "without coupling" if coupling is None else "with coupling"
        for still, moves in (("x", "y"), ("y", "x")):
            found = swung(used, MIDDLE, {moves: sine(2.0, 24.0)})
            error = np.ptp(found.error(still)) / 22.0
            print(f"{what}: {still} at rest moves by {100 * error:.3f} % of the swing of {moves}")
    for mode in (Mode.FEEDFORWARD, Mode.ADAPTIVE, Mode.TRIMMED):
        for conditioned in (False, True):
            circle(used.model_copy(update={"mode": mode}), conditioned=conditioned)


def circle(config: DaemonConfig, *, conditioned: bool) -> None:
    """Print the contour error of a circle, also about its own centre, beside the worse axis."""
    waves = {"x": sine(7.0, 18.0, 90.0), "y": sine(7.0, 18.0)}
    found = swung(config, MIDDLE, waves, conditioned=conditioned)
    names = ("x", "y")
    for centre, what in (
        ([12.5, 12.5], f"{config.mode}, {'conditioned' if conditioned else 'never moved'}"),
        ([found.true[name].mean() for name in names], "about its own centre"),
    ):
        x_um, y_um = (found.true[n] - at for n, at in zip(names, centre, strict=True))
        off = np.abs(np.hypot(x_um, y_um) - 5.5).max()
        each = {n: found.error(n) + at - 12.5 for n, at in zip(names, centre, strict=True)}
        worst = max(np.abs(error).max() for error in each.values())
        print(
            f"circle of 11 µm, {what}: contour error {off:.4f} µm, {off / worst:.2f} of that of "
            f"the worse axis; means {', '.join(f'{e.mean():.4f}' for e in each.values())} µm"
        )


def late() -> None:
    """Print the errors of two axes that move each other later, at several frequencies."""
    for lag_s in LAGS_S:
        config = at_rate(CONFIG / "coupled.yaml")
        devices = {
            name: device.model_copy(
                update={"options": device.options.model_copy(update={"coupling_lag_s": lag_s})}
            )
            for name, device in config.devices.items()
        }
        print(f"moved {1e3 * lag_s:g} ms later:")
        _with_and_without_lag(config.model_copy(update={"devices": devices}))


def _with_and_without_lag(config: DaemonConfig) -> None:
    if (transform := config.transform) is None:
        raise SystemExit("coupled.yaml has no transform")
    coupling = coupling_of(config, 2.0)
    for hz in (0.25, 1.0, 5.0, 10.0):
        left = []
        for used in (coupling.model_copy(update={"lags_s": {}}), coupling):
            one = transform.model_copy(update={"coupling": used})
            rig = VirtualRig(config.model_copy(update={"transform": one}))
            rig.run(rig.ask(rq.Path(points=(MIDDLE,))) + 1.0)
            wave = rq.Wave(command_um={"y": sine(7.0, 18.0, hz=hz)}, duration_s=16.0)
            found = rig.run(rig.ask(wave))
            left.append(100 * np.ptp(found.error("x")[-round(8 * RATE_HZ) :]) / 11.0)
        print(
            f"{hz:g} Hz: x at rest moves by {left[0]:.3f} % of the swing of y, "
            f"with the lag by {left[1]:.3f} %"
        )


def table() -> None:
    """Print the errors of the table where it has arrived, in mode `trimmed`."""
    config = at_rate(CONFIG / "tip-tilt.yaml").model_copy(update={"mode": Mode.TRIMMED})
    rig, worst = VirtualRig(config), dict.fromkeys(config.user_axes, 0.0)
    for point in POINTS:
        rig.run(rig.ask(rq.Path(points=(point,))) + 1.0)
        found = rig.run(0.5)
        for name, axis in config.user_axes.items():
            worst[name] = max(worst[name], abs(found.error(name).mean()) / np.ptp(axis.range))
    text = ", ".join(f"{name} {100 * error:.3f} %" for name, error in worst.items())
    print(f"table at {len(POINTS)} points: worst errors {text} of the range")


if __name__ == "__main__":
    two_axes()
    late()
    table()
