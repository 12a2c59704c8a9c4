"""The report of `piezod probe` on one device."""

from collections.abc import Iterable, Mapping
from typing import Final

from piezod.commission.probe import Probed, RoundTrip

_ABILITIES: Final = {
    "read_back": "read back",
    "enables": "enable outputs",
    "soft_disable": "ramp a disabled output down slowly",
    "watchdog": "make its outputs safe by itself",
    "quality": "mark invalid samples",
    "holds": "hold its outputs when closed",
}
"""Capabilities of a device, in words."""


def device_text(name: str, found: Probed, stage_rate_hz: float) -> str:
    """Return the report on a device, several lines.

    Args:
        name: Name of the device.
        found: Result of the inspection.
        stage_rate_hz: `rate_hz` of the configuration, in Hz.
    """
    rows = {"identity": ", ".join(found.identity or ())}
    if (able := found.capabilities) is not None:
        rows["can"] = ", ".join(_abilities(able._asdict()))
        if able.ranges:
            ends = [f"{low:.6g} to {high:.6g}" for low, high in able.ranges]
            rows["range"] = _channels(zip(able.outputs, ends, strict=True), found.units.outputs)
    rows["reads"] = _values(found.readings, found.units.inputs)
    rows["in force"] = _values(found.in_force, found.units.outputs)
    rows["read"] = _round_trip(found.read)
    rows["read back"] = _round_trip(found.read_back)
    rows["ERROR"] = found.error
    rows["allows"] = "" if found.error else rate_text(found.rate_hz, stage_rate_hz)
    lines = (f"  {heading:9} {text}" for heading, text in rows.items() if text)
    return "\n".join((f"{name} (driver {found.driver})", *lines))


def rate_text(allowed_hz: float, stage_rate_hz: float) -> str:
    """Return an allowed rate as text, with the configured rate if that is higher.

    Args:
        allowed_hz: Highest rate in the cycle, in Hz.
        stage_rate_hz: `rate_hz` of the configuration, in Hz.
    """
    configured = "" if stage_rate_hz <= allowed_hz else f"; rate_hz is {stage_rate_hz:g}"
    return f"{allowed_hz:.0f} Hz in the cycle{configured}"


def _abilities(able: Mapping[str, object]) -> list[str]:
    return [text for key, text in _ABILITIES.items() if able[key]] or ["only read and write"]


def _values(values: Mapping[str, float], units: Mapping[str, str]) -> str:
    return _channels(((channel, f"{value:.6g}") for channel, value in values.items()), units)


def _channels(texts: Iterable[tuple[str, str]], units: Mapping[str, str]) -> str:
    """Return each channel with a text and its unit, if the unit is known."""
    return ", ".join(f"{name} {text} {units.get(name, '')}".rstrip() for name, text in texts)


def _round_trip(trip: RoundTrip | None) -> str:
    if trip is None:
        return ""
    failed = f", {trip.failed_pct:.0f} % failed" if trip.failed_pct else ""
    each = ((trip.median_us, "median"), (trip.p90_us, "p90"), (trip.p99_us, "p99"))
    return ", ".join(f"{took_us:.0f} µs {name}" for took_us, name in each) + failed
