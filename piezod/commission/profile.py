"""What was found, as the configuration of a daemon."""

from math import pi
from typing import Any, Final

import yaml

from piezod.commission.procedure import Findings
from piezod.config.axes import AxisConfig
from piezod.config.daemon import DaemonConfig
from piezod.devices.interface import Identity

RANGE_PART: Final = 0.9
"""Part of the travel that is offered for commands: loops and drift need the rest."""
WORKING_PART: Final = 0.1
"""Highest frequency that is worked at, as a part of the first mode; of the rate where no mode is
known."""


def profile(
    config: DaemonConfig, axis: str, findings: Findings, identities: dict[str, Identity], date: str
) -> str:
    """Return a configuration with one axis as it was found.

    Args:
        config: The configuration that was commissioned with.
        axis: Name of the axis.
        findings: What was found; travel at least.
        identities: Of the devices.
        date: The day, for people.
    """
    one = config.axes[axis]
    document = config.model_dump(mode="json", exclude_unset=True)
    serving = {channel.device for _, channel in one.channels()}
    document["devices"] = {
        name: document["devices"][name] for name in document["devices"] if name in serving
    }
    document["axes"] = {axis: _axis(one, document["axes"][axis], findings, config.rate_hz)}
    lines = [f"# Axis {axis}, commissioned on {date} by `piezod commission`."]
    lines += [f"# {name}: {', '.join(identity)}" for name, identity in identities.items()]
    lines += [f"# {line}" for line in _found(findings)]
    return "\n".join([*lines, "", yaml.safe_dump(document, sort_keys=False, allow_unicode=True)])


def _found(findings: Findings) -> list[str]:
    lines = []
    if noise := findings.noise:
        lines.append(f"noise of the sensor {noise.rms_um * 1e3:.1f} nm rms")
    if travel := findings.travel:
        lines.append(f"travel {abs(travel.travel_um):.3f} µm, loop {travel.loop_pct:.1f} % wide")
    response = findings.response
    if response is not None and response.found:
        lines.append(f"delay {response.delay_s * 1e3:.3f} ± {response.uncertainty_s * 1e3:.3f} ms")
    return lines


def _axis(
    config: AxisConfig, document: dict[str, Any], findings: Findings, rate_hz: float
) -> dict[str, Any]:
    travel, found = findings.travel, dict(document)
    if travel is None:
        return found
    limits = dict(found["limits"])
    limits["drive_min_v"] = max(config.limits.drive_min_v, round(travel.drive_low_v, 3))
    limits["drive_max_v"] = min(config.limits.drive_max_v, round(travel.drive_high_v, 3))
    limits["rest_v"] = min(max(config.limits.rest_v, limits["drive_min_v"]), limits["drive_max_v"])
    working_hz = WORKING_PART * rate_hz
    if findings.ringing is not None and findings.ringing.found:
        ringing = findings.ringing
        working_hz = min(working_hz, WORKING_PART * ringing.frequency_hz)
        found["first_mode"] = {
            "frequency_hz": round(ringing.frequency_hz, 1),
            "damping": round(min(max(ringing.damping, 0.001), 1.0), 4),
        }
    swing_v = limits["drive_max_v"] - limits["drive_min_v"]
    wanted_v_per_s = float(f"{pi * working_hz * swing_v:.2g}")
    limits["slew_v_per_s"] = max(1.0, min(config.limits.slew_v_per_s, wanted_v_per_s))
    found["limits"] = limits
    found["command_range_um"] = [0.0, round(RANGE_PART * abs(travel.travel_um), 2)]
    if travel.travel_um < 0:
        found["sensor"] = _turned(config)
    found.pop("model", None)  # another stage's; `piezod identify --live` makes this one's
    compensator = dict(found.get("compensator", {}))
    if findings.response is not None and findings.response.found:
        compensator["delay_s"] = round(findings.response.delay_s, 6)
    found["compensator"] = compensator
    safety = dict(found.get("safety", {}))
    if "ramp_v_per_s" in safety:
        safety["ramp_v_per_s"] = min(safety["ramp_v_per_s"], limits["slew_v_per_s"])
        found["safety"] = safety
    return found


def _turned(config: AxisConfig) -> dict[str, Any]:
    """Return the sensor, its calibration turned over: the position is to rise with the drive."""
    sensor = config.sensor.model_dump(mode="json", exclude_none=True)
    calibration = sensor["calibration"]
    match calibration["kind"]:
        case "line":
            calibration |= {key: -calibration[key] for key in ("gain", "offset")}
        case "polynomial":
            calibration["coefficients"] = [-each for each in calibration["coefficients"]]
        case _:
            calibration["physical"] = [-each for each in calibration["physical"]]
    return sensor
