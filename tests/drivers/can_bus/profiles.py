"""The emulated nodes on a CAN bus and the options of their drivers."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from piezod.devices.interface import Wiring
from tests.drivers.bus.profiles import Profile

CODES = {"code_at_min": -32_767, "code_at_max": 32_767, "range": (-10.0, 10.0)}
DBC = Path(__file__).parents[3] / "config" / "devices" / "can-dbc-demo.dbc"
GROUP = "239.74.163.44"


def bus_at(where: str) -> dict[str, object]:
    """Return the options of the bus at a place that `piezod emulate` has printed."""
    if where.startswith("udp:"):
        _, group, port = where.split(":")
        return {"interface": "udp_multicast", "channel": group, "port": int(port)}
    return {"interface": "slcan", "channel": where}


def canopen(where: str, timeout_ms: float = 1000.0, **more: object) -> dict[str, Any]:
    """Return options of driver `canopen` for the emulated node, without a watchdog."""
    options: dict[str, Any] = {
        "bus": bus_at(where),
        "node": 5,
        "timeout_ms": timeout_ms,
        "inputs": {"ai1": {"number": 1, **CODES}},
        "outputs": {"ao1": {"number": 1, **CODES}},
    }
    return {**options, **more}


def polled(where: str, timeout_ms: float = 1000.0) -> dict[str, Any]:
    """Return options of driver `can_dbc` for the emulated device, polled by a request."""
    status = {"message": "Status"}
    return {
        "bus": bus_at(where),
        "dbc": DBC,
        "timeout_ms": timeout_ms,
        "inputs": {"position": {**status, "signal": "Position"}},
        "outputs": {
            "drive": {
                "message": "Command",
                "signal": "Drive",
                "read_back": {**status, "signal": "DriveMeasured"},
            }
        },
        "constants": {"Command": {"Enable": 1}},
        "request": "Poll",
        "echoes": {"Status": "Echo"},
        "counters": dict.fromkeys(("Command", "Poll", "Status"), "Counter"),
        "checksums": {name: {"signal": "Crc"} for name in ("Command", "Poll", "Status")},
        "flags": {"saturated": {**status, "signal": "Saturated"}},
    }


def reported(where: str, timeout_ms: float = 1000.0) -> dict[str, Any]:
    """Return options of driver `can_dbc` for the emulated device, which sends by itself."""
    options = polled(where, timeout_ms)
    for key in ("request", "echoes", "flags"):
        del options[key]
    options["max_age_ms"] = timeout_ms
    options["inputs"]["position"]["message"] = "Report"
    options["outputs"]["drive"]["read_back"]["message"] = "Report"
    for key in ("counters", "checksums"):
        options[key]["Report"] = options[key].pop("Status")
    return options


def _by_pdo(where: str, timeout_ms: float) -> Mapping[str, object]:
    return canopen(where, timeout_ms, read_back="pdo")


_NODE = Wiring(("ai1",), ("ao1",))
_DEMO = Wiring(("position",), ("drive",))

CANOPEN = Profile("canopen-401", "canopen", _NODE, canopen)
CANOPEN_PDO = Profile("canopen-401", "canopen", _NODE, _by_pdo, takes_long=True)
POLLED = Profile("can-dbc-demo", "can_dbc", _DEMO, polled)
REPORTED = Profile("can-dbc-demo", "can_dbc", _DEMO, reported)
