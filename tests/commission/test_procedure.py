"""The whole procedure, at several rates and initial voltages."""

from pathlib import Path

import numpy as np
import pytest

from piezod.commission.procedure import Findings, ProcedureStep, steps_of
from piezod.commission.profile import profile
from piezod.commission.session import Session
from piezod.config.daemon import StageAxisConfig, load_daemon
from piezod.control.guard import Limits
from piezod.devices import registry
from piezod.devices.interface import Device, Identity
from piezod.testing.faulty import FaultyDevice
from piezod.testing.injections import Injection, InjectionKind
from tests.commission.axes import configured, resting_at, session

STAGE = {"reversible_um": 12.0, "irreversible_um": 18.0}
RIG = {"sensor": {"delay_s": 1e-4}, "amplifier": {"gain_error": 0.0}, "stage": STAGE}
WHO = {"rig": Identity("maker", "model", "serial", "firmware")}


def done(axis: Session, findings: Findings) -> list[ProcedureStep]:
    """Do all steps of an axis."""
    steps = []
    for step in steps_of(axis, findings):
        steps.append(step)
        assert step.run()
    return steps


def commissioned(findings: Findings, folder: Path) -> StageAxisConfig:
    """Return the axis of the configuration made from the results."""
    path = folder / "stage.yaml"
    path.write_text(profile(configured(), "x", findings, WHO, "2026-01-01"), encoding="utf-8")
    return load_daemon(path, registry).axes["x"]


@pytest.mark.parametrize(
    "rate_hz",
    [*(pytest.param(rate_hz, marks=pytest.mark.stress) for rate_hz in (10.0, 20.0, 25.0)), 100.0],
)
def test_a_slow_axis_is_commissioned(rate_hz: float, tmp_path: Path) -> None:
    """Travel and polarity are found, no mode is invented, and the axis is back."""
    findings = Findings()
    with session(RIG, rate_hz=rate_hz) as axis:
        done(axis, findings)

        assert axis.drive_v == pytest.approx(0.0, abs=1e-9)
    assert findings.travel is not None
    assert findings.travel.travel_um == pytest.approx(30.0, rel=0.05)
    assert findings.ringing is not None
    assert not findings.ringing.found
    assert commissioned(findings, tmp_path).limits.drive_max_v == 150.0


def turned(device: Device) -> Device:
    """Reverse the sign of a sensor whose stage is at 100 V initially."""
    left = resting_at(100.0)(device)
    return FaultyDevice(left, [Injection(InjectionKind.GAIN, 0, value=-1.0)])  # type: ignore[arg-type] # the rig is both


@pytest.mark.parametrize(
    ("wrap", "gain"), [(resting_at(100.0), 1.0), (turned, -1.0)], ids=["rises", "falls"]
)
def test_an_axis_found_high_up_keeps_its_polarity(
    wrap: object, gain: float, tmp_path: Path
) -> None:
    """It is driven down; the polarity does not depend on that direction."""
    findings = Findings()
    with session(RIG, wrap=wrap, rate_hz=200.0) as axis:  # type: ignore[arg-type] # a factory
        done(axis, findings)

    assert findings.travel is not None
    assert findings.travel.travel_um * gain < 0
    one = commissioned(findings, tmp_path)
    assert one.sensor.calibration.gain == gain  # type: ignore[union-attr] # a line
    assert one.limits.drive_min_v == 0.0
    assert one.limits.drive_max_v == pytest.approx(100.0, abs=0.5)


def test_the_announced_voltages_are_driven() -> None:
    """This also holds if the bias changes which end of the range is farther."""
    findings = Findings()
    with session(RIG, wrap=resting_at(49.0), limits=Limits(0.0, 100.0, 20_000.0)) as axis:
        steps = {step.name: step for step in done(axis, findings)}

    bias_v = axis.found_v + 10.0
    for name in ("delay", "ringing"):
        drive_v = findings.traces[name].drive_v
        assert f"ramp to {bias_v:.1f} V, " in steps[name].what
        assert " of +4.0 V from there" in steps[name].what
        assert np.min(drive_v) == pytest.approx(bias_v, abs=1e-6)
        assert np.max(drive_v) == pytest.approx(bias_v + 4.0, abs=0.01)


def test_texts_tell_the_numbers_that_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    """The texts contain the duration of the noise record and the number of steps."""
    monkeypatch.setattr("piezod.commission.procedure.DURATION_S", 4.5)
    monkeypatch.setattr("piezod.commission.procedure.REPEATS", 7)
    with session(RIG) as axis:
        noise, polarity, *_ = steps_of(axis, Findings())

    assert "for 4.5 s" in noise.what
    assert "7 times +3.00 V" in polarity.what
