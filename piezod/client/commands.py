"""The requests to the loop, as methods of both clients."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from piezod.client.calls import Call, Waveforms, command
from piezod.client.methods import ClientMethod, PlainMethod
from piezod.config.modes import Mode
from piezod.messages.answers import Answer
from piezod.messages.documents import Document

if TYPE_CHECKING:
    from piezod.config.model_file import ModelFile


class StageCommands:
    """Methods that send one request each; they return when the loop has accepted it."""

    @ClientMethod
    def arm(self, *, shadow: bool = False, confirm_output: bool = False) -> Call[Answer]:
        """Take over the read-back voltage and hold it: SAFE to READY.

        Args:
            shadow: Compute everything, write nothing.
            confirm_output: You have seen that the output is at its read-back, whatever contradicts
                it; without a read-back, that it is at the safe voltage.
        """
        return command("arm", shadow=shadow, confirm_output=confirm_output)

    disarm = PlainMethod(Answer, "Ramp to the safe voltage, then SAFE; needs no lease.")

    @ClientMethod
    def mode(self, name: Mode | str, *, axis: str | None = None) -> Call[Answer]:
        """Select how piezod computes the drive voltage; in READY this starts RUN.

        Args:
            name: One of `piezod.config.modes.Mode`.
            axis: Name of the axis; None for all axes.
        """
        return command("mode", mode=name, axis=axis)

    @ClientMethod
    def condition(self, *, axis: str | None = None) -> Call[Answer]:
        """Swing over the whole range, which makes the hysteresis memory known.

        Args:
            axis: Name of the axis; None for all axes.
        """
        return command("condition", axis=axis)

    @ClientMethod
    def zero(self, *, axis: str | None = None) -> Call[Answer]:
        """Make the displacement at the rest voltage the sensor zero.

        Args:
            axis: Name of the axis; None for all axes.
        """
        return command("zero", axis=axis)

    @ClientMethod
    def goto(
        self, position_um: float, *, axis: str | None = None, speed_um_per_s: float | None = None
    ) -> Call[Answer]:
        """Start a movement to a position, where the stage stays; in READY this starts RUN.

        Args:
            position_um: Target, in µm.
            axis: Name of the axis; None for the only axis.
            speed_um_per_s: Speed, in µm/s; None for the configured speed.
        """
        return command("goto", position_um=position_um, axis=axis, speed_um_per_s=speed_um_per_s)

    @ClientMethod
    def path(
        self, points: Sequence[Mapping[str, float]], *, speed_per_s: float | None = None
    ) -> Call[Answer]:
        """Move user axes on straight lines through points, with a stop at each.

        Args:
            points: Points: position of each user axis that moves, in its unit.
            speed_per_s: Highest speed of an axis, in its unit per s; None for the configured ones.
        """
        return command("path", points=tuple(points), speed_per_s=speed_per_s)

    @ClientMethod
    def wave(
        self,
        command_um: Waveforms,
        duration_s: float,
        *,
        start_s: float | None = None,
        pulses: Sequence[Document] = (),
        edges: Document | None = None,
    ) -> Call[Answer]:
        """Follow a waveform, then hold its last position.

        The stage first moves from its present position to the start of the waveform.

        Args:
            command_um: Axis: position over time in µm, a waveform as in experiment files.
            duration_s: Duration of the waveform, in s.
            start_s: Instant at which the waveform begins, at most 30 s ahead, in s as
                `time.monotonic()` on the machine of the daemon; None for as soon as possible.
            pulses: Pulses of lines in step with it, with the fields of `LinePulses`.
            edges: Edges of a line for which it waits, with the fields of `LineEdges`.
        """
        return command(
            "wave",
            command_um=command_um,
            duration_s=duration_s,
            start_s=start_s,
            pulses=tuple(pulses) or None,
            edges=edges,
        )

    @ClientMethod
    def follow(self, *, axis: str | None = None) -> Call[Answer]:
        """Follow the command input of an axis; HOLD as soon as it has no usable value.

        Args:
            axis: Name of the axis; None for all axes with a command input.
        """
        return command("follow", axis=axis)

    hold = PlainMethod(Answer, "Hold the present voltage; needs no lease.")
    resume = PlainMethod(Answer, "Continue after a hold, from the present position: HOLD to RUN.")
    stop = PlainMethod(Answer, "Ramp to the safe voltage, then SAFE; needs no lease.")
    estop = PlainMethod(Answer, "Stop in an emergency, as configured; needs no lease.")

    @ClientMethod
    def reset(self, *, engineer: bool = False) -> Call[Answer]:
        """Clear faults that are gone, and leave FAULT for SAFE if none is present any more.

        Args:
            engineer: Also end the faults that only an engineer may end.
        """
        return command("reset", engineer=engineer)

    @ClientMethod
    def identify(self, drive_v: Waveforms, duration_s: float) -> Call[Answer]:
        """Drive voltage waveforms from rest to rest, to record data for a model.

        Args:
            drive_v: Axis: drive voltage over time in V, a waveform as in experiment files; all
                other axes rest.
            duration_s: Duration of the waveforms, in s.
        """
        return command("identify", drive_v=drive_v, duration_s=duration_s)

    @ClientMethod
    def play(
        self,
        drive_v: Sequence[float],
        *,
        interval_s: float,
        cycles: int,
        lead_in_v: Sequence[float] = (),
        axis: str | None = None,
        start_s: float | None = None,
    ) -> Call[Answer]:
        """Let the device play a table of voltages by its own clock; `played` returns the record.

        READY follows when it has ended.

        Args:
            drive_v: Voltages of one period, in V; at most 16,000.
            interval_s: Time between two of them, in s.
            cycles: Number of periods.
            lead_in_v: Voltages before the first period, in V; at most 16,000.
            axis: Name of the axis; None for the only axis.
            start_s: Instant at which the device is started, as in `wave`; the device must have the
                table by then.
        """
        return command(
            "play",
            drive_v=tuple(drive_v),
            lead_in_v=tuple(lead_in_v),
            interval_s=interval_s,
            cycles=cycles,
            axis=axis,
            start_s=start_s,
        )

    @ClientMethod
    def scan(  # noqa: PLR0913 - each is a field of the request
        self,
        axes: Mapping[str, Mapping[str, Sequence[float]]],
        *,
        interval_s: float,
        pulses: Sequence[int] = (),
        frame_pulse: int = 0,
        frame_points: int = 0,
        pause: int = 0,
        edges: Mapping[str, float] | None = None,
        compared: Mapping[str, float] | None = None,
    ) -> Call[Answer]:
        """Let the device of some axes play a scan by its own clock; `scanned` returns the samples.

        READY follows when it has ended. `piezod.experiment.live.scan.scan_live` makes the curves.

        Args:
            axes: Axis: its curves `lead_in_v`, `line_v`, `offset_v`, `scale` and `blend`, in V.
            interval_s: Time between two points, in s.
            pulses: Bits of the lines of pulses that are high at each point of a sweep, or of all
                sweeps of `line_v`.
            frame_pulse: Bits that pulse once, at the first point.
            frame_points: Points for which they are high.
            pause: Point of a sweep at which the fast axis stands still.
            edges: Where it waits for edges: `first`, `every` and `tail` in points, `times`, and
                `within_s`.
            compared: Pulses by the device's own comparison: `line`, and the readings `first_um`,
                `last_um` and `step_um` of the first axis.
        """
        return command(
            "scan",
            axes=axes,
            interval_s=interval_s,
            pulses=tuple(pulses),
            frame_pulse=frame_pulse,
            frame_points=frame_points,
            pause=pause,
            edges=edges,
            compared=compared,
        )

    @ClientMethod
    def adopt(
        self, model: "ModelFile", *, axis: str | None = None, zero_um: float | None = None
    ) -> Call[Answer]:
        """Use another model from now on; only while disarmed.

        Args:
            model: The model, from `piezod.config.model_file.load_model`.
            axis: Name of the axis; None for the only axis.
            zero_um: Sensor zero to restore, in µm.
        """
        return command("adopt", model=model, axis=axis, zero_um=zero_um)

    shutdown = PlainMethod(Answer, "Ramp to the safe voltage and end the daemon.")
