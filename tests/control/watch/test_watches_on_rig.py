"""Tests of the watches on the simulated rig, with all parts from requests to devices."""

from collections.abc import Mapping
from itertools import product

import pytest

from piezod.config.modes import CORRECTED, Mode
from piezod.config.waveforms.combined import WaveformConfig
from piezod.config.waveforms.paths import Staircase
from piezod.config.waveforms.shapes import Sine, Triangle
from piezod.devices.interface import Amplifier, Device, Sensor
from piezod.messages import requests as rq
from piezod.testing.faulty import FaultyDevice
from piezod.testing.injections import Injection, InjectionKind
from tests.conftest import Reaction
from tests.control.fakes import MS
from tests.control.fault_cases import implausible_from
from tests.control.rig_stage import RigStage, shipped_config

SLOW = Sine(kind="sine", low=1, high=25, frequency_hz=1)
WAVES: Mapping[str, WaveformConfig] = {
    "slow sine": SLOW,
    "quick sine": Sine(kind="sine", low=3, high=23, frequency_hz=50),
    "slow triangle": Triangle(kind="triangle", low=1, high=25, frequency_hz=0.2),
    "quick triangle": Triangle(kind="triangle", low=1, high=25, frequency_hz=20),
    "steps": Staircase(kind="staircase", levels=(1, 25, 3, 20, 5, 24, 1, 10, 12, 1), dwell_s=0.1),
    "small steps": Staircase(
        kind="staircase", levels=tuple(5 + 0.25 * k for k in range(60)), dwell_s=0.03
    ),
}
START_MS = 137
"""The drive then rises fastest."""
LEARNED_MS = 6137
"""Likewise; by then the usual noise is known."""


def arm_in(stage: RigStage, mode: Mode) -> None:
    """Arm a stage and select a mode."""
    stage.until("SAFE")
    stage.do(rq.Arm(), rq.SelectMode(mode=mode))


def run_all(stage: RigStage, wave_s: float, rest_s: float) -> None:
    """Run every waveform, go to a position, and rest there."""
    for wave in WAVES.values():
        stage.do(rq.Wave(command_um={"x": wave}, duration_s=wave_s))
        stage.run(wave_s + 0.3)
        stage.records.clear()
    stage.do(rq.Goto(position_um=12.5))
    stage.run(rest_s)


@pytest.mark.parametrize("mode", Mode)
def test_healthy_stage_has_no_fault(mode: Mode) -> None:
    """Sines, triangles, steps at the slew rate, and rest; in every mode."""
    stage = RigStage()
    arm_in(stage, mode)
    run_all(stage, 1.0, 5.0)

    assert stage.faults() == []
    assert stage.state == "RUN"


@pytest.mark.stress
@pytest.mark.parametrize("rate_hz", [100.0, 1000.0, 10_000.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_healthy_stage_has_no_fault_for_long(rate_hz: float, seed: int) -> None:
    """With another specimen, at other rates, in all modes one after the other."""
    config = RigStage().config.model_copy(update={"rate_hz": rate_hz, "seed": seed})
    stage = RigStage(config)
    stage.until("SAFE")
    stage.run(3.0)
    stage.do(rq.Arm())
    for mode in Mode:
        stage.do(rq.SelectMode(mode=mode))
        run_all(stage, 2000 / rate_hz, 5000 / rate_hz)

    assert stage.faults() == []


def faulty(kind: InjectionKind, value: float, mode: Mode) -> RigStage:
    """Return a stage at 1 kHz on a slow sine, that fails when its drive rises fastest."""
    start_ms = LEARNED_MS if kind is InjectionKind.NOISE else START_MS

    def wrap(device: Device) -> Device:
        assert isinstance(device, Sensor)
        assert isinstance(device, Amplifier)
        return FaultyDevice(device, [Injection(kind, start_ms * MS, value=value)])

    stage = RigStage(shipped_config().model_copy(update={"rate_hz": 1000.0}), wrap)
    arm_in(stage, mode)
    stage.do(rq.Wave(command_um={"x": SLOW}, duration_s=100.0))
    while stage.t_ns < (start_ms - 1) * MS:
        stage.cycle()
    assert stage.faults() == []
    stage.records.clear()
    return stage


FAULTS = (
    (InjectionKind.REPLACED, float("nan"), "S2", 5),
    (InjectionKind.REPLACED, 100.0, "S3", 4),
    (InjectionKind.OFFSET, 6.0, "S9", 4),
    (InjectionKind.OFFSET, -6.0, "S9", 4),
    (InjectionKind.GAIN, 0.5, "S9", 120),
    (InjectionKind.GAIN, 2.0, "S9", 20),
    (InjectionKind.GAIN, -1.0, "S9", 20),
    (InjectionKind.GARBAGE, 1e6, "S3", 4),
    (InjectionKind.DROPPED, 0.0, "S5", 5),
    (InjectionKind.LATE, 2.0 * MS, "S6", 25),
    (InjectionKind.DUPLICATE, 0.0, "S11", 5),
    (InjectionKind.NOISE, 0.3, "S12", 1000),
    (InjectionKind.REFUSED, 0.0, "A1", 6),
    (InjectionKind.STUCK_OUTPUT, 0.0, "A3", 20),
    (InjectionKind.READ_BACK_OFFSET, 1.0, "A3", 4),
    (InjectionKind.READ_BACK_OFFSET, -25.0, "A7", 1),
)
"""Injection, its value, the fault that it causes, and within how many cycles."""


def marks_of(kind: InjectionKind, fault: str, mode: Mode) -> list[pytest.MarkDecorator]:
    """Return the marks of a case; long are those with a feedback, and of noise in adaptive."""
    proves = pytest.mark.fault(fault)
    brief = mode is Mode.FEEDFORWARD or (mode is Mode.ADAPTIVE and kind is not InjectionKind.NOISE)
    return [proves] if brief else [proves, pytest.mark.stress]


@pytest.mark.parametrize(
    ("kind", "value", "fault", "within_ms", "mode"),
    [
        pytest.param(*row, mode, marks=marks_of(row[0], row[2], mode))
        for row, mode in product(FAULTS, (Mode.FEEDFORWARD, Mode.ADAPTIVE, *CORRECTED))
    ],
)
def test_fault_is_detected_in_time(
    kind: InjectionKind, value: float, fault: str, within_ms: int, mode: Mode, reaction: Reaction
) -> None:
    """In any mode the fault comes within its cycles, and no other fault before it."""
    stage = faulty(kind, value, mode)
    before_ns = stage.t_ns
    stage.run((within_ms + 1) / 1000)

    assert fault in stage.faults()
    assert set(stage.faults()) <= {"S4", fault}
    if kind is not InjectionKind.STUCK_OUTPUT:  # not visible before the drive has moved farther
        grows = (kind, value) == (InjectionKind.GAIN, 0.5)
        visible = implausible_from(stage, stage.records) if grows else 0
        reaction(fault, cycles=stage.cycles_to(fault, before_ns) - visible)


@pytest.mark.fault("S1")
@pytest.mark.fault("S13")
@pytest.mark.parametrize(("mode", "state"), [(Mode.FEEDFORWARD, "RUN"), (Mode.ADAPTIVE, "HOLD")])
def test_stuck_sensor_stops_only_modes_that_need_it(mode: Mode, state: str) -> None:
    """The other mode continues with a warning."""
    stage = faulty(InjectionKind.STUCK, 0.0, mode)
    stage.run(0.1)

    assert stage.faults()[0] == ("S1" if mode is Mode.ADAPTIVE else "S13")
    assert stage.state == state
