"""The requests to the owner of a stage, and their rows in the table of commands.

Clients, the service and the loop use the same classes: each is a small model with a `kind`. The
docstring of a class is the help of the command line, of OpenAPI and of docs/client.md. `axis` names
one axis; if it is None, the request is for the only axis, or for all axes if the request allows
several.
"""

from collections.abc import Iterator, Mapping
from inspect import cleandoc
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.config.model_file import ModelFile
from piezod.config.quantities import (
    DriveV,
    DurationS,
    Fraction,
    ModeName,
    Name,
    PositionUm,
    StartS,
)
from piezod.config.waveforms.combined import WaveformConfig
from piezod.messages.endpoints import (
    CHANGE,
    CHANGE_BY_CURVES,
    CHANGE_BY_POINTS,
    EMERGENCY,
    END,
    ENDPOINTS,
    TOWARDS_SAFETY,
    WITH_LEASE,
    WITH_LEASE_BY_POINTS,
    Access,
    Endpoint,
    Group,
)

Waveforms: TypeAlias = Annotated[dict[Name, WaveformConfig], Field(min_length=1)]
Point: TypeAlias = Annotated[dict[Name, PositionUm], Field(min_length=1, max_length=16)]
AxisName: TypeAlias = Name | None
ScanV: TypeAlias = Annotated[tuple[DriveV, ...], Field(max_length=40_000)]
Scale: TypeAlias = Annotated[float, Quantity(0.1, 10)]
PulseBits: TypeAlias = Annotated[int, Quantity(0, 255)]
WaveTime: TypeAlias = Annotated[float, Quantity(0, 1e5, "s")]
TableV: TypeAlias = Annotated[tuple[DriveV, ...], Field(max_length=16_000)]


class Arm(ConfigModel):
    """Take over the read-back voltage and hold it.

    SAFE becomes READY. In shadow mode piezod computes everything and writes nothing.
    """

    kind: Literal["arm"] = "arm"
    shadow: bool = Field(default=False, description="Compute everything, write nothing.")
    confirm_output: bool = Field(
        default=False,
        description="You have seen that the output is at its read-back, whatever contradicts it; "
        "without a read-back, that it is at the safe voltage.",
    )


class Disarm(ConfigModel):
    """Ramp to the safe voltage, then write nothing more.

    It needs no lease.
    """

    kind: Literal["disarm"] = "disarm"


class SelectMode(ConfigModel):
    """Select the mode: how piezod computes the drive voltage.

    The modes are `uncompensated`, `feedforward`, `adaptive`, `trimmed` and `closed`. In READY
    this starts RUN.
    """

    kind: Literal["mode"] = "mode"
    mode: ModeName
    axis: AxisName = None


class Goto(ConfigModel):
    """Move to a position and stay there.

    In READY this starts RUN in the mode selected last.
    """

    kind: Literal["goto"] = "goto"
    axis: AxisName = None
    position_um: PositionUm
    speed_um_per_s: Annotated[float, Quantity(1e-3, 1e6, "µm/s")] | None = None


class Path(ConfigModel):
    """Move user axes on straight lines from point to point, with a stop at each.

    All axes begin and end together. The user axes are those of `transform:`.
    """

    kind: Literal["path"] = "path"
    points: tuple[Point, ...] = Field(
        min_length=1, max_length=1000, description="Points: position of each user axis that moves."
    )
    speed_per_s: Annotated[float, Quantity(1e-3, 1e6)] | None = Field(
        default=None, description="Highest speed of an axis, in its unit per s."
    )


class LinePulses(ConfigModel):
    """Pulses of a line in step with a waveform: trains of equal pulses."""

    line: Name = Field(description="Name of the line, an output.")
    begins_s: Annotated[tuple[WaveTime, ...], Field(min_length=1, max_length=10_000)] = Field(
        description="Time of the first pulse of each train since the begin of the waveform, s."
    )
    every_s: Annotated[float, Quantity(1e-5, 1e5, "s")] = Field(
        default=1.0, description="Time from pulse to pulse of a train, s."
    )
    times: Annotated[int, Quantity(1, 1_000_000)] = Field(
        default=1, description="Pulses of a train."
    )
    high_s: Annotated[float, Quantity(1e-5, 1e5, "s")] = Field(
        description="Time for which a pulse is high, s."
    )


class LineEdges(ConfigModel):
    """Times of a waveform at which it stands still until a rising edge of a line."""

    line: Name = Field(description="Name of the line.")
    first_s: WaveTime = Field(description="Time of the first one since its begin, s.")
    every_s: Annotated[float, Quantity(1e-5, 1e5, "s")] = Field(
        default=1.0, description="Time from there to each further one, s."
    )
    times: Annotated[int, Quantity(1, 20_000)] = Field(default=1, description="Their number.")
    within_s: Annotated[float, Quantity(0.01, 3600, "s")] = Field(
        description="Longest wait, s; the movement ends there without an edge."
    )


class Wave(ConfigModel):
    """Follow a waveform, then hold its last position.

    The stage first moves from its present position to the start of the waveform. Lines of the stage
    may pulse in step with it, and it may wait for edges of a line.
    """

    kind: Literal["wave"] = "wave"
    command_um: Waveforms = Field(description="Axis: position over time, µm.")
    duration_s: DurationS
    start_s: StartS = None
    pulses: Annotated[tuple[LinePulses, ...], Field(max_length=8)] | None = Field(
        default=None, description="Pulses of lines in step with it; default: none."
    )
    edges: LineEdges | None = Field(
        default=None, description="Edges for which it waits; default: none."
    )


class Stream(ConfigModel):
    """Follow the setpoints of a stream; the service sends this when a stream begins."""

    kind: Literal["stream"] = "stream"
    axes: tuple[Name, ...] = Field(min_length=1)


class Follow(ConfigModel):
    """Follow the command input of the axis.

    The command input is an input of a device, for instance an analogue signal, that the
    configuration names (`command_input`). If it has no usable value within the range of commands
    for 0.1 s, or 5 cycles if that is longer, the stage goes to HOLD; `resume` before the next
    movement.
    """

    kind: Literal["follow"] = "follow"
    axis: AxisName = None


class Hold(ConfigModel):
    """Hold the present voltage.

    It needs no lease.
    """

    kind: Literal["hold"] = "hold"


class Resume(ConfigModel):
    """Continue after HOLD, from the present position."""

    kind: Literal["resume"] = "resume"


class Stop(ConfigModel):
    """Ramp to the safe voltage, then go to SAFE.

    It needs no lease.
    """

    kind: Literal["stop"] = "stop"


class Estop(ConfigModel):
    """Stop in an emergency.

    The stage ramps to the safe voltage, or the amplifier cuts its output, as configured. It needs
    no lease.
    """

    kind: Literal["estop"] = "estop"


class Reset(ConfigModel):
    """Clear faults that are gone, and leave FAULT for SAFE if none is present any more.

    This is also the way out after an emergency stop.
    """

    kind: Literal["reset"] = "reset"
    engineer: bool = Field(
        default=False, description="Also end the faults that only an engineer may end."
    )


class Condition(ConfigModel):
    """Swing over the whole range, which makes the hysteresis memory known.

    The stage ends at the rest voltage.
    """

    kind: Literal["condition"] = "condition"
    axis: AxisName = None


class Zero(ConfigModel):
    """Make the displacement at the rest voltage the sensor zero."""

    kind: Literal["zero"] = "zero"
    axis: AxisName = None


class Identify(ConfigModel):
    """Drive voltage waveforms, to record data for a model.

    The stage begins and ends at the rest voltage.
    """

    kind: Literal["identify"] = "identify"
    drive_v: Waveforms = Field(description="Axis: drive voltage over time, V; all others rest.")
    duration_s: DurationS


class Play(ConfigModel):
    """Let the device of an axis play a table of voltages by its own clock, and record the sensor.

    The axis ramps to the first voltage, and to the rest voltage afterwards. Meanwhile it follows no
    command, and the loop measures nothing. `GET /v1/play` returns the record.
    """

    kind: Literal["play"] = "play"
    axis: AxisName = None
    drive_v: TableV = Field(min_length=2, description="Voltages of one period, V.")
    lead_in_v: TableV = Field(default=(), description="Voltages before the first period, V.")
    interval_s: Annotated[float, Quantity(1e-6, 1, "s")] = Field(
        description="Time between two of them, s."
    )
    cycles: Annotated[int, Quantity(1, 100_000)] = Field(description="Number of periods.")
    start_s: StartS = None


class ScanCurve(ConfigModel):
    """Voltages of an axis in a scan: offset + scale · line, blended to the next sweep's."""

    lead_in_v: ScanV = Field(description="Voltages before the first sweep, V.")
    line_v: ScanV = Field(
        min_length=2, description="Shape of one or several sweeps, which repeat, V."
    )
    offset_v: Annotated[tuple[DriveV, ...], Field(max_length=20_000)] = Field(
        min_length=1, description="Offset of each sweep, V."
    )
    scale: Annotated[tuple[Scale, ...], Field(max_length=20_000)] = Field(
        min_length=1, description="Size of the line in each sweep."
    )
    blend: Annotated[tuple[Fraction, ...], Field(max_length=20_000)] = Field(
        min_length=2, description="Share of the next sweep's offset and scale at each point."
    )


class ScanEdges(ConfigModel):
    """Where a scan waits for rising edges at the trigger input of its device."""

    first: Annotated[int, Quantity(0, 20_000)] = Field(
        description="Point before which it waits, the first of the first sweep is 0."
    )
    every: Annotated[int, Quantity(1, 20_000)] = Field(
        default=1, description="Points from there to each further wait."
    )
    times: Annotated[int, Quantity(1, 20_000)] = Field(default=1, description="Number of waits.")
    within_s: Annotated[float, Quantity(0.01, 3600, "s")] = Field(
        description="Longest wait, s; the scan ends there without an edge."
    )
    tail: Annotated[int, Quantity(0, 40_000)] = Field(
        default=0, description="Points behind the last sweep, in which edges are counted."
    )


class ScanCompared(ConfigModel):
    """Pulses that the device gives by comparing the reading of the first axis, in one direction."""

    line: Annotated[int, Quantity(1, 8)] = Field(description="Line of pulses.")
    first_um: PositionUm = Field(description="Reading at the first pulse, µm.")
    last_um: PositionUm = Field(description="Reading behind which no pulse comes, µm.")
    step_um: PositionUm = Field(description="From pulse to pulse, µm; negative on the way down.")

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if not self.step_um * (self.last_um - self.first_um) > 0.0:
            yield ("step_um",), f"does not lead from first_um to last_um (got {self.step_um:g} µm)"


class Scan(ConfigModel):
    """Let the device of some axes play a scan by its own clock, and record all axes.

    The axes ramp to their first voltages, and to the rest voltage afterwards. A scan that does not
    fit into the device is played in parts, between which the axes hold. Meanwhile they follow no
    command, and the loop measures nothing. `GET /v1/scan` returns the samples.
    """

    kind: Literal["scan"] = "scan"
    axes: Annotated[dict[Name, ScanCurve], Field(min_length=1, max_length=8)] = Field(
        description="Axis: its voltages."
    )
    interval_s: Annotated[float, Quantity(1e-6, 1, "s")] = Field(
        description="Time between two points, s."
    )
    pulses: Annotated[tuple[PulseBits, ...], Field(max_length=20_000)] = Field(
        default=(),
        description="Bits of the lines of pulses that are high at each point of one sweep, or of "
        "all sweeps of `line_v`.",
    )
    frame_pulse: PulseBits = Field(default=0, description="Bits that pulse at the first point.")
    frame_points: Annotated[int, Quantity(0, 20_000)] = Field(
        default=0, description="Points for which they are high."
    )
    pause: Annotated[int, Quantity(0, 20_000)] = Field(
        default=0,
        description="Point of a sweep at which the fast axis stands still: parts end there.",
    )
    edges: ScanEdges | None = Field(
        default=None, description="Where it waits for edges; the device takes it as a whole then."
    )
    compared: ScanCompared | None = Field(
        default=None, description="Pulses by the device's own comparison; as a whole, too."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        first = next(iter(self.axes.values()))
        for name, curve in self.axes.items():
            for key in ("lead_in_v", "line_v", "offset_v", "scale", "blend"):
                n, wanted = len(getattr(curve, key)), len(getattr(first, key))
                wanted = len(curve.offset_v) if key == "scale" else wanted
                if n != wanted:
                    yield ("axes", name, key), f"has {n} numbers, {wanted} are needed"
        points = len(first.blend)
        if len(first.line_v) % points:
            what = f"has {len(first.line_v)} numbers, a multiple of {points} is needed"
            yield ("axes", next(iter(self.axes)), "line_v"), what
        if self.pulses and len(self.pulses) not in {points, len(first.line_v)}:
            what = f"has {len(self.pulses)} numbers, {points} or {len(first.line_v)} are needed"
            yield ("pulses",), what
        for key in ("frame_points", "pause"):
            if (value := getattr(self, key)) > points:
                yield (key,), f"above the {points} points of a sweep (got {value})"


class AdoptModel(ConfigModel):
    """Use another model from now on; only while disarmed."""

    kind: Literal["adopt"] = "adopt"
    axis: AxisName = None
    model: ModelFile
    zero_um: PositionUm | None = Field(default=None, description="Sensor zero to restore, µm.")


class Shutdown(ConfigModel):
    """Ramp to the safe voltage and end the daemon."""

    kind: Literal["shutdown"] = "shutdown"


Request: TypeAlias = Annotated[
    Arm
    | Disarm
    | SelectMode
    | Goto
    | Path
    | Wave
    | Stream
    | Follow
    | Hold
    | Resume
    | Stop
    | Estop
    | Reset
    | Condition
    | Zero
    | Identify
    | Play
    | Scan
    | AdoptModel
    | Shutdown,
    Field(discriminator="kind"),
]


def _row(
    request: type[ConfigModel],
    access: Access,
    group: Group | None = None,
    *,
    done: str = "",
    path: str = "",
) -> Endpoint:
    """Return the row of a request; name, path and verb are its kind if nothing else is given."""
    kind: str = request.model_fields["kind"].default
    help = cleandoc(request.__doc__ or "")
    verb = kind if group else ""
    at = path or kind
    return Endpoint(kind, "POST", at, access, help, group, verb, done, request, answer="Answer")


_ROWS: Final = (
    _row(Arm, WITH_LEASE, Group.OPERATE),
    _row(Disarm, TOWARDS_SAFETY, Group.OPERATE, done="ramping to the safe voltage, then disarmed"),
    _row(SelectMode, WITH_LEASE, Group.OPERATE),
    _row(
        Condition,
        CHANGE,
        Group.OPERATE,
        done="conditioning; `piezod status` shows READY when it is over",
    ),
    _row(
        Zero,
        WITH_LEASE,
        Group.OPERATE,
        done="the displacement at the rest voltage is zero from now on",
    ),
    _row(Goto, WITH_LEASE, Group.MOVE),
    _row(Path, WITH_LEASE_BY_POINTS, Group.MOVE),
    _row(Wave, WITH_LEASE_BY_POINTS, Group.MOVE),
    _row(Follow, WITH_LEASE, Group.MOVE, done="following the command input"),
    _row(Hold, TOWARDS_SAFETY, Group.MOVE, done="holding the voltage; `piezod resume` continues"),
    _row(Resume, WITH_LEASE, Group.MOVE, done="continuing from the present position"),
    _row(Stop, TOWARDS_SAFETY, Group.STOP, done="ramping to the safe voltage"),
    _row(Estop, EMERGENCY, Group.STOP, done="emergency stop; `piezod reset` ends it"),
    _row(Reset, WITH_LEASE, Group.STOP),
    _row(Identify, CHANGE_BY_POINTS),
    _row(Play, CHANGE_BY_POINTS),
    _row(Scan, CHANGE_BY_CURVES),
    _row(AdoptModel, CHANGE_BY_POINTS, path="model"),
    _row(Shutdown, END),
)
TABLE: Final[Mapping[str, Endpoint]] = {row.name: row for row in _ROWS} | dict(ENDPOINTS)
"""The table of commands: every endpoint, by name."""
REQUESTS: Final = {row.name: row.request for row in _ROWS if row.request is not None}
"""The request classes, by name."""
