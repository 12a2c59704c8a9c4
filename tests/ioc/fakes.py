"""Records without EPICS, and telemetry of a stage that nobody runs."""

from collections.abc import Iterator
from contextlib import contextmanager

from piezod.ioc.motor_fields import FIELDS
from piezod.ioc.readings import DOWN, Alarm, Reading
from piezod.messages.telemetry import AxisTelemetry, Range, Telemetry


class FakeMotor:
    """A motor record.

    Attributes:
        alarm: Its alarm.
        fields: The fields that are numbers.
        done: The values of DMOV, as a monitor sees them.
        failed: Whether each movement that has ended has failed.
        targets_when_done: VAL each time that DMOV rose.
    """

    def __init__(self) -> None:
        self.alarm = DOWN
        self.fields = {
            each.name: float(each.start) for each in FIELDS if not isinstance(each.start, str)
        }
        self.done: list[float] = []
        self.failed: list[bool] = []
        self.targets_when_done: list[float] = []

    def get(self, field: str) -> float:
        return self.fields[field]

    def set(self, alarm: Alarm | None = None, *, failed: bool = False, **values: float) -> None:
        self.alarm = alarm or self.alarm
        if values.get("DMOV", self.fields["DMOV"]) != self.fields["DMOV"]:
            self.done.append(float(values["DMOV"]))
            if values["DMOV"]:
                self.failed.append(failed)
                self.targets_when_done.append(values.get("VAL", self.fields["VAL"]))
        self.fields.update(values)

    @contextmanager
    def locked(self) -> Iterator[None]:
        yield


class FakeRecords:
    """Records that keep what was set; a test sets what a client would write.

    Attributes:
        readings: Newest reading of each record.
        settings: Values of the records that clients write.
    """

    def __init__(self) -> None:
        self.readings: dict[str, Reading] = {}
        self.settings: dict[str, object] = {}

    def set(self, name: str, reading: Reading) -> None:
        self.readings[name] = reading

    def set_alarm(self, name: str, alarm: Alarm) -> None:
        self.readings[name] = Reading(getattr(self.readings.get(name), "value", 0), alarm)

    def get(self, name: str) -> object:
        return self.settings[name]


def axis(
    position_um: float | None = 1.0,
    target_um: float | None = 1.0,
    *,
    command_um: float | None = 1.0,
    motion: int = 0,
    on_target: bool = False,
) -> AxisTelemetry:
    """Return an axis in one interval."""

    def same(value: float | None) -> Range:
        return Range(min=value, max=value, last=value)

    return AxisTelemetry(
        position_um=same(position_um),
        command_um=same(command_um),
        drive_v=same(10.0),
        error_um=same(None),
        target_um=target_um,
        mode="trimmed",
        on_target=on_target,
        motion=motion,
    )


def interval(state: str = "RUN", t_s: float = 0.0, **axes: AxisTelemetry) -> Telemetry:
    """Return one interval of telemetry."""
    return Telemetry(
        t_s=t_s,
        cycles=4,
        lost=0,
        state=state,
        faults=(),
        skipped_cycles=3,
        late_max_us=70.0,
        axes=axes,
    )
