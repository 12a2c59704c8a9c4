"""Bodies for the endpoints that do not accept an empty body."""

import json
from typing import Any, Final

import httpx

WAVE: Final = {"kind": "sine", "low": 1.0, "high": 2.0, "frequency_hz": 5.0}
MODEL: Final = {
    "created_at": "2026-11-21T12:00:00+00:00",
    "created_by": "a test",
    "method": "lms",
    "source": {"file": "a.csv", "sha256": "0" * 64},
    "fit": {"voltage_error_max_pct": 1.0, "voltage_error_rms_pct": 0.5},
    "drive_low_v": 0.0,
    "drive_high_v": 100.0,
    "position_low_um": 0.0,
    "position_high_um": 20.0,
    "delay_s": 0.0,
    "right_stop_thresholds": [0.5],
    "right_stop_weights": [0.1],
    "left_stop_thresholds": [0.5],
    "left_stop_weights": [0.1],
}
BODIES: Final[dict[str, Any]] = {
    "mode": {"mode": "adaptive"},
    "goto": {"position_um": 12.5},
    "wave": {"command_um": {"x": WAVE}, "duration_s": 1.0},
    "path": {"points": [{"x": 1.0}]},
    "scan": {
        "axes": {
            "x": {
                "lead_in_v": [0.0, 0.5],
                "line_v": [1.0, 2.0],
                "offset_v": [0.0],
                "scale": [1.0],
                "blend": [0.0, 1.0],
            }
        },
        "interval_s": 1e-3,
    },
    "play": {"drive_v": [1.0, 2.0], "interval_s": 1e-3, "cycles": 2},
    "identify": {"drive_v": {"x": WAVE}, "duration_s": 1.0},
    "model": {"model": MODEL},
    "stream": {"x": 1.0},
    "params/restore": {"sequence": 1},
    "recordings/keep": {"name": "20261121T120000Z"},
}


def answer_of(client: httpx.Client, endpoint: tuple[str, str]) -> httpx.Response:
    """Use an endpoint with a valid body; of answers without an end only the beginning is read."""
    method, path = endpoint[0], endpoint[1].removeprefix("/v1/")
    text = json.dumps(BODIES.get(path, {})) if method == "POST" else None
    headers = {"content-type": "application/json"}
    with client.stream(method, path, content=text, headers=headers) as answer:
        if path not in {"telemetry", "session"} or answer.is_error:
            answer.read()
    return answer
