"""The examples of `config/devices`, at an emulator's place instead of a real port."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

EXAMPLES = Path(__file__).parents[2] / "config" / "devices"
MODELS = EXAMPLES.parent / "models"

Place = Callable[[dict[str, Any], str], None]
"""Writes the place of an emulator into the options of a device."""


def at_port(options: dict[str, Any], where: str) -> None:
    """Enter a serial port."""
    options["port"] = where


def at_pty(options: dict[str, Any], where: str) -> None:
    """Enter a port without a real line behind it, which needs no silence between frames."""
    at_port(options, where)
    options["silence_ms"] = 0


def at_host(options: dict[str, Any], where: str) -> None:
    """Enter a TCP address."""
    options["host"], _, port = where.rpartition(":")
    options["tcp_port"] = int(port)
    options.pop("port", None)
    options.pop("baud", None)


def at_multicast(options: dict[str, Any], where: str) -> None:
    """Enter a CAN bus over UDP."""
    group, _, port = where.removeprefix("udp:").rpartition(":")
    options["bus"] = {"interface": "udp_multicast", "channel": group, "port": int(port)}
    options.pop("watchdog_ms", None)  # the floor sends no heartbeat


def at_adapter(options: dict[str, Any], where: str) -> None:
    """Enter an slcan adapter."""
    options["bus"] = {"interface": "slcan", "channel": where, "bit_rate": 500_000}
    options.pop("watchdog_ms", None)


def placed(example: str, where: list[str], place: Place, rate_hz: float = 0.0) -> dict[str, Any]:
    """Return an example whose devices are at other places, in their order.

    Args:
        example: Name of the example, without the suffix.
        where: Places of the emulators of its devices.
        place: Writes a place into options.
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
