"""The results of commissioning as the configuration of a daemon."""

from math import pi
from typing import Any, Final

import yaml

from piezod.commission.procedure import Findings
from piezod.config.channels import InputConfig
from piezod.config.daemon import DaemonConfig, StageAxisConfig
from piezod.control.guard import read_back_tolerance_v
from piezod.devices.interface import Identity

RANGE_PART: Final = 0.9
"""Range of commands as a fraction of the travel: loops and drift need the rest."""
WORKING_PART: Final = 0.1
"""Highest working frequency as a fraction of the first mode, or of the rate without a mode."""


def profile(
    config: DaemonConfig, axis: str, findings: Findings, identities: dict[str, Identity], date: str
) -> str:
    """Return a configuration with one axis, from the results; at least the travel is known."""
    one = config.axes[axis]
    # Only the keys that were set: defaults stay defaults, also in later versions.
    document = config.model_dump(mode="json", exclude_unset=True)
    serving = {channel.device for _, channel in one.channels()}
    document["devices"] = {
        name: document["devices"][name] for name in document["devices"] if name in serving
    }
    document["axes"] = {axis: _axis(one, document["axes"][axis], findings, config.rate_hz)}
    lines = [f"# Axis {axis}, commissioned on {date} by `piezod commission`."]
    lines += [f"# {name}: {', '.join(identity)}" for name, identity in identities.items()]
    lines += [f"# {line}" for line in [*_found(findings), *_narrowed(one, findings)]]
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


def _narrowed(config: StageAxisConfig, findings: Findings) -> list[str]:
    """Return a comment on limits that are narrower than before."""
    if (travel := findings.travel) is None:
        return []
    low_v, high_v = config.limits.drive_min_v, config.limits.drive_max_v
    lost_v = max(travel.drive_low_v - low_v, high_v - travel.drive_high_v)
    if lost_v <= read_back_tolerance_v(low_v, high_v):
        return []
    # Displacement and slope have the same sign only if the voltage was raised.
    upwards = (travel.travel_um < 0) == (travel.um_per_v < 0)
    found_v = travel.drive_low_v if upwards else travel.drive_high_v
    driven = f"{travel.drive_low_v:.1f} to {travel.drive_high_v:.1f} V"
    return [
        f"LIMITS ARE NARROWER than {low_v:g} to {high_v:g} V: only {driven} were driven,",
        f"because the axis was found at {found_v:.1f} V. For the whole range, commission it again",
        "from one end, with all steps of the travel.",
    ]


def _axis(
    config: StageAxisConfig, document: dict[str, Any], findings: Findings, rate_hz: float
) -> dict[str, Any]:
    travel, found = findings.travel, dict(document)
    if travel is None:
        return found
    limits = dict(found["limits"])
    # Never beyond the configured limits, only to the range that was driven.
    limits["drive_min_v"] = max(config.limits.drive_min_v, round(travel.drive_low_v, 3))
    limits["drive_max_v"] = min(config.limits.drive_max_v, round(travel.drive_high_v, 3))
    limits["rest_v"] = _clamped(config.limits.rest_v, limits)
    working_hz = WORKING_PART * rate_hz
    if findings.ringing is not None and findings.ringing.found:
        ringing = findings.ringing
        working_hz = min(working_hz, WORKING_PART * ringing.frequency_hz)
        found["first_mode"] = {
            "frequency_hz": round(ringing.frequency_hz, 1),
            "damping": round(min(max(ringing.damping, 0.001), 1.0), 4),  # the range of the schema
        }
    swing_v = limits["drive_max_v"] - limits["drive_min_v"]
    # Slew rate of a sine over the full swing at the working frequency, to two digits.
    wanted_v_per_s = float(f"{pi * working_hz * swing_v:.2g}")
    limits["slew_v_per_s"] = max(1.0, min(config.limits.slew_v_per_s, wanted_v_per_s))
    found["limits"] = limits
    found["command_range_um"] = [0.0, round(RANGE_PART * abs(travel.travel_um), 2)]
    if travel.um_per_v < 0 and config.sensor is not None:
        found["sensor"] = _reversed_sensor(config.sensor)
    found.pop("model", None)  # of another stage; `piezod identify --live` makes a new one
    found.pop("response", None)  # likewise; `piezod response` makes a new one
    compensator = dict(found.get("compensator", {}))
    if findings.response is not None and findings.response.found:
        compensator["delay_s"] = round(findings.response.delay_s, 6)
    found["compensator"] = compensator
    if safety := _safety(config, dict(found.get("safety", {})), limits):
        found["safety"] = safety
    return found


def _safety(
    config: StageAxisConfig, document: dict[str, Any], limits: dict[str, float]
) -> dict[str, Any]:
    """Return the safety values, within the new limits; defaults are checked too."""
    if config.safety.safe_v is not None:
        document["safe_v"] = _clamped(config.safety.safe_v, limits)
    if config.safety.ramp_v_per_s > limits["slew_v_per_s"]:
        document["ramp_v_per_s"] = limits["slew_v_per_s"]
    return document


def _clamped(drive_v: float, limits: dict[str, float]) -> float:
    return min(max(drive_v, limits["drive_min_v"]), limits["drive_max_v"])


def _reversed_sensor(config: InputConfig) -> dict[str, Any]:
    """Return the sensor with reversed sign, so that the position rises with the drive."""
    sensor = config.model_dump(mode="json", exclude_none=True)
    calibration = sensor["calibration"]
    match calibration["kind"]:
        case "line":
            # Gain and offset: the calibration gives the physical value with reversed sign.
            calibration |= {key: -calibration[key] for key in ("gain", "offset")}
        case "polynomial":
            calibration["coefficients"] = [-each for each in calibration["coefficients"]]
        case _:
            calibration["physical"] = [-each for each in calibration["physical"]]
    return sensor
