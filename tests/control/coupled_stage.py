"""A stage with user axes on ideal devices, whose actuators move each other."""

from collections import deque
from collections.abc import Sequence
from typing import Any

from piezod.config.daemon import DaemonConfig
from piezod.config.fields import Context
from piezod.config.validate import validate
from piezod.config.yaml_loader import parse_yaml
from piezod.control.assembly import assemble
from piezod.control.stage.answer import Answer
from piezod.control.warm_up import IdealDevices
from piezod.coordinates.matrices import Matrix, times
from piezod.devices import registry
from piezod.devices.interface import Sample
from piezod.messages import requests as rq
from piezod.telemetry.record import AxisRecord, CycleRecord, StageEvent
from piezod.units import NS_PER_S
from tests.control.rig_stage import ON_TIME

RATE_HZ = 200.0
UM_PER_V = 0.1

TWO = """
axes:
  x: {range: [1, 9], tolerance: 0.01, settle_s: 0}
  y: {range: [1, 9], tolerance: 0.01, settle_s: 0}
actuators: {a: {x: 1}, b: {y: 1}}
coupling: {shares: {a: {b: 0.03}, b: {a: 0.03}}}
"""
TABLE = """
axes:
  z: {range: [1, 9], tolerance: 0.01, settle_s: 0}
  rx: {unit: µrad, range: [-500, 500], speed_per_s: 5000, tolerance: 1, settle_s: 0}
  ry: {unit: µrad, range: [-500, 500], speed_per_s: 5000, tolerance: 1, settle_s: 0}
actuators:
  a: {z: 1, rx: 0.01}
  b: {z: 1, rx: -0.005, ry: 0.00866}
  c: {z: 1, rx: -0.005, ry: -0.00866}
"""


def stage_config(transform: str, actuators: str) -> DaemonConfig:
    """Return the configuration of a stage whose actuators go 0 to 10 µm, each with a letter."""
    axis = (
        "{amplifier: rig, sensor: rig, command_range_um: [0, 10], speed_um_per_s: 200, "
        "limits: {drive_min_v: 0, drive_max_v: 100, slew_v_per_s: 100000, rest_v: 0}}"
    )
    axes = "".join(f"  {name}: {axis}\n" for name in actuators)
    indented = "".join(f"  {line}\n" for line in transform.strip().splitlines())
    text = (
        f"rate_hz: {RATE_HZ:g}\ndevices: {{rig: {{driver: simulated}}}}\n"
        f"axes:\n{axes}transform:\n{indented}"
    )
    return validate(parse_yaml(text, "stage.yaml"), DaemonConfig, Context(drivers=registry))


class CoupledDevices(IdealDevices):
    """Ideal devices; each sensor shows a little of the other actuators, some cycles later."""

    def __init__(self, config: DaemonConfig, coupling: Matrix, late_cycles: int) -> None:
        super().__init__(config)
        self._coupling = coupling
        self._past: deque[list[float]] = deque(maxlen=late_cycles + 1)
        self.invalid: set[int] = set()
        """Sensors that show nothing."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return what the sensors show."""
        own_um = [sample.position_um for sample in super().read(now_ns)]
        self._past.append(own_um)
        before_um = self._past[0]
        moved_um = times(self._coupling, before_um)  # its diagonal is 1
        shown_um = [
            um + moved - before
            for um, moved, before in zip(own_um, moved_um, before_um, strict=True)
        ]
        return [Sample(now_ns, um, i not in self.invalid) for i, um in enumerate(shown_um)]


class CoupledStage:
    """The stage, armed, cycle by cycle.

    Args:
        transform: Its `transform:`.
        actuators: Its actuators, each a letter.
        share: How far each actuator moves the sensors of the others.
        late_cycles: How much later.
    """

    def __init__(
        self,
        transform: str = TWO,
        actuators: str = "ab",
        share: float = 0.03,
        late_cycles: int = 0,
    ) -> None:
        self.config = stage_config(transform, actuators)
        size = len(actuators)
        coupling = tuple(tuple(1.0 if i == j else share for j in range(size)) for i in range(size))
        self.devices = CoupledDevices(self.config, coupling, late_cycles)
        self.controller = assemble(self.config, self.devices, self.devices.capabilities())
        self.t_ns, self._period_ns = NS_PER_S, round(NS_PER_S / RATE_HZ)
        self.events: list[StageEvent] = []
        self.run(0.3)
        assert self.ask(rq.Arm()).accepted
        self.run(0.1)

    def ask(self, request: rq.Request) -> Answer:
        """Return the answer to a request."""
        return self.controller.execute(request, self.t_ns)

    def cycle(self) -> CycleRecord:
        """Run one cycle."""
        self.t_ns += self._period_ns
        record = self.controller.cycle(self.t_ns, ON_TIME)
        self.events += self.controller.take_events()
        return record

    def run(self, duration_s: float) -> list[dict[str, AxisRecord]]:
        """Run for a while; return the records of the axes by name."""
        records = [self.cycle() for _ in range(round(duration_s * RATE_HZ))]
        names = self.config.shown_axes
        return [dict(zip(names, record.axes, strict=True)) for record in records]

    def set(self, **setpoints: float) -> None:
        """Give a stream the next setpoints."""
        for name, value in setpoints.items():
            place = self.config.shown_axes.index(name)
            self.controller.stream_um(place, value, self.t_ns)


def point(record: dict[str, AxisRecord], *names: str) -> list[Any]:
    """Return the commands of user axes."""
    return [record[name].command_um for name in names]
