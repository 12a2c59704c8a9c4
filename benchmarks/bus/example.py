"""The examples of `config/devices`, at an emulator's place instead of a real port."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

EXAMPLES = Path(__file__).parents[2] / "config" / "devices"
MODELS = EXAMPLES.parent / "models"

Place = Callable[[dict[str, Any], str], None]
"""Puts where an emulator is served into the options of a device."""


def at_port(options: dict[str, Any], where: str) -> None:
    """Put a serial port there."""
    options["port"] = where


def at_pty(options: dict[str, Any], where: str) -> None:
    """Put a port there that has no line behind it, so that it need not rest between frames."""
    at_port(options, where)
    options["silence_ms"] = 0


def at_host(options: dict[str, Any], where: str) -> None:
    """Put a TCP address there."""
    options["host"], _, port = where.rpartition(":")
    options["tcp_port"] = int(port)
    options.pop("port", None)
    options.pop("baud", None)


def at_multicast(options: dict[str, Any], where: str) -> None:
    """Put a CAN bus over UDP there."""
    group, _, port = where.removeprefix("udp:").rpartition(":")
    options["bus"] = {"interface": "udp_multicast", "channel": group, "port": int(port)}
    options.pop("watchdog_ms", None)  # the floor sends no heartbeat


def at_adapter(options: dict[str, Any], where: str) -> None:
    """Put an slcan adapter there."""
    options["bus"] = {"interface": "slcan", "channel": where, "bit_rate": 500_000}
    options.pop("watchdog_ms", None)


def placed(example: str, where: list[str], place: Place, rate_hz: float = 0.0) -> dict[str, Any]:
    """Return an example whose devices are at other places, in their order.

    Args:
        example: Its name, without the suffix.
        where: Where the emulators of its devices are served.
        place: Puts that into options.
        rate_hz: Rate of the loop, that of the example if 0.
    """
    text = (EXAMPLES / f"{example}.yaml").read_text(encoding="utf-8")
    document: dict[str, Any] = yaml.safe_load(text)
    for device, its_place in zip(document["devices"].values(), where, strict=True):
        place(device["options"], its_place)
        if "dbc" in device["options"]:
            device["options"]["dbc"] = str(EXAMPLES / device["options"]["dbc"])
    for axis in document["axes"].values():
        axis["model"] = str(MODELS / "simulated-stack.yaml")
    if rate_hz:
        document["rate_hz"] = rate_hz
    return document
