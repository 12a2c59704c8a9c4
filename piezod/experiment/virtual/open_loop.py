"""An axis that drives a voltage waveform, to record data for an identification."""

from math import nan

from piezod.config.gate_reasons import GateReason
from piezod.config.modes import Mode
from piezod.control.guard import Limits
from piezod.control.law.axis import AxisOutput, TimeFunction
from piezod.devices.interface import Sample
from piezod.telemetry.record import AxisRecord
from piezod.units import NS_PER_S


class OpenLoopAxis:
    """Drives a voltage waveform; positions are recorded, not used. Real-time safe."""

    def __init__(
        self,
        waveform_v: TimeFunction,
        limits: Limits,
        in_force_v: float,
        start_ns: int,
        period_ns: int,
    ) -> None:
        self._waveform_v, self._limits = waveform_v, limits
        self._in_force_v = in_force_v
        self._start_ns, self._period_s = start_ns, period_ns / NS_PER_S

    def update(self, t_ns: int, sample: Sample) -> AxisOutput:  # noqa: ARG002 - open loop
        """Return the voltage for this cycle."""
        requested_v = self._waveform_v((t_ns - self._start_ns) / NS_PER_S)
        drive_v = self._limits.admit(requested_v, self._in_force_v, self._period_s)
        return AxisOutput(drive_v, float("nan"), requested_v, self._in_force_v, t_ns)

    def applied(self, drive_v: float) -> None:
        """Take the voltage that is in force from now on, in V."""
        self._in_force_v = drive_v

    def record(
        self, sample: Sample, output: AxisOutput, drive_v: float, read_back_v: float
    ) -> AxisRecord:
        """Return the record of this axis."""
        return AxisRecord(
            sample_ns=sample.t_ns,
            position_um=sample.position_um if sample.valid else nan,
            command_um=nan,
            target_um=nan,
            uncompensated_v=output.uncompensated_v,
            asked_v=output.drive_v,
            drive_v=drive_v,
            in_force_v=output.in_force_v,
            read_back_v=read_back_v,
            trim_um=0.0,
            mode=Mode.UNCOMPENSATED,
            gate=GateReason.QUIET,
            on_target=False,
            motion=0,
            limited=output.limited,
        )
