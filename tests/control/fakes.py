"""Fake devices, axes and algorithms, which a test controls and which record their calls."""

from collections.abc import Sequence
from math import nan

from piezod.config.gate_reasons import GateReason
from piezod.config.modes import Mode
from piezod.control.law.axis import AxisOutput
from piezod.control.law.identifier import LearningGate
from piezod.control.law.trim import Trim
from piezod.devices.interface import Sample
from piezod.devices.status import NO_FLAGS, Flags
from piezod.hysteresis import LMSIdentifier, even_thresholds, new_bank
from piezod.telemetry.record import AxisRecord

MS = 1_000_000


class FakeDevices:
    """Sensors and amplifiers of two axes."""

    def __init__(self, log: list[str], samples: Sequence[Sample]) -> None:
        self.log, self.samples = log, samples
        self.refuses = False
        self.drive_v: Sequence[float] = (0.0, 0.0)

    def activate(self, now_ns: int) -> None:
        """Do nothing."""

    def deactivate(self, now_ns: int) -> None:
        """Do nothing."""

    def zero(self, zero_um: Sequence[float], true_zero_um: Sequence[float]) -> None:
        """Do nothing."""

    def forget(self) -> None:
        """Do nothing."""

    def commands(self) -> Sequence[Sample]:
        """Return no command."""
        return [Sample(0, nan, False)] * len(self.samples)

    def status(self, now_ns: int) -> Sequence[Flags]:  # noqa: ARG002 - asked for by StageDevices
        """Report nothing."""
        return [NO_FLAGS] * (2 * len(self.samples))

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return the samples."""
        self.log.append(f"read at {now_ns}")
        return self.samples

    def set_lines(self, now_ns: int, *, at_rest: bool) -> None:
        """Do nothing."""

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the voltages that were taken last."""
        self.log.append(f"read back at {now_ns}")
        return self.drive_v

    def watchdogs(self) -> Sequence[bool]:
        """Return that no amplifier has a watchdog."""
        return [False] * len(self.samples)

    def reads_back(self) -> Sequence[bool]:
        """Return that every amplifier reads back."""
        return [True] * len(self.samples)

    def read_back_age_ns(self, now_ns: int) -> Sequence[int]:  # noqa: ARG002 - asked for by StageDevices
        """Return that every read-back is of this cycle."""
        return [0] * len(self.samples)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Take the voltages, unless `refuses` is set."""
        self.log.append(f"write {list(drive_v)} at {now_ns}")
        if not self.refuses:
            self.drive_v = drive_v
        return not self.refuses


class FakeAxis:
    """An axis that requests a fixed voltage."""

    def __init__(self, log: list[str], name: str, drive_v: float) -> None:
        self.log, self.name, self.drive_v = log, name, drive_v

    def update(self, t_ns: int, sample: Sample) -> AxisOutput:
        """Return the voltage."""
        self.log.append(f"{self.name} updates at {t_ns} with {sample.position_um} µm")
        return AxisOutput(self.drive_v, 0.0, 0.0, 0.0, t_ns)

    def applied(self, drive_v: float) -> None:
        """Record the voltage in force."""
        self.log.append(f"{self.name} has {drive_v} V")

    def record(
        self, sample: Sample, output: AxisOutput, drive_v: float, read_back_v: float
    ) -> AxisRecord:
        """Return the record of the cycle."""
        return AxisRecord(
            sample_ns=sample.t_ns,
            position_um=sample.position_um,
            command_um=output.command_um,
            target_um=nan,
            uncompensated_v=output.uncompensated_v,
            asked_v=output.drive_v,
            drive_v=drive_v,
            in_force_v=output.in_force_v,
            read_back_v=read_back_v,
            trim_um=0.0,
            mode=Mode.FEEDFORWARD,
            gate=GateReason.OPEN,
            on_target=False,
            motion=0,
            limited=output.limited,
        )


class RecordingIdentifier(LMSIdentifier):
    """Records its pairs, and returns the errors that a test sets."""

    def __init__(self, errors: Sequence[float] = ()) -> None:
        super().__init__(new_bank(even_thresholds(1), even_thresholds(1)))
        self.pairs: list[tuple[float, float]] = []
        self.learned: list[bool] = []
        self.errors = list(errors)
        self.at_rest = False

    @property
    def position(self) -> float:
        """Return a position that changes with every pair, unless `at_rest` is set."""
        return 0.0 if self.at_rest else float(len(self.pairs))

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Record a pair, and whether it is learned from."""
        self.pairs.append((position, drive))
        self.learned.append(learn)
        return self.errors.pop(0) if self.errors else 1.0


class FakeGate(LearningGate):
    """A gate with the decision that a test sets; it records its arguments."""

    def __init__(self) -> None:
        super().__init__(MS)
        self.asked: list[tuple[bool, int, bool]] = []
        self.reason, self.credible, self.accurate = GateReason.OPEN, True, True

    def admits(
        self,
        *,
        valid: bool,
        age_ns: int,
        limited: bool,
        drive: float,  # noqa: ARG002 - asked for by LearningGate
        position: float,  # noqa: ARG002 - asked for by LearningGate
    ) -> bool:
        """Return the decision."""
        self.asked.append((valid, age_ns, limited))
        return self.reason is GateReason.OPEN


class FakeTrim(Trim):
    """A trim that records its errors and adds nothing."""

    def __init__(self) -> None:
        super().__init__(1.0, 1e-3, 0.05, 1)
        self.active = True
        self.errors: list[float] = []
        self.valid: list[bool] = []
        self.limited: list[int] = []

    def step(self, error: float, valid: bool, limited: int) -> float:
        """Record the error."""
        self.errors.append(error)
        self.valid.append(valid)
        self.limited.append(limited)
        return 0.0
