"""What the profiles of a driver were checked against, other than code of their own authors."""

import json
from importlib.resources import files
from typing import Final

from pydantic import BaseModel

from piezod.devices.plugins import points_of
from piezod.devices.registry import GROUP

FILE: Final = "evidence.json"
"""File in the package of a driver: word by profile, by driver."""


def evidence_of(driver: str) -> dict[str, str]:
    """Return what each profile of an installed driver was checked against.

    The words are, the strongest first: "hardware" (a device, by a signed record of `piezod
    acceptance`), "capture" (bytes of a real device), "real firmware" (on an emulated processor),
    "kernel driver" (a driver of the Linux kernel), "node" (somebody else's device in software),
    "client" (somebody else's program for the device), "manual" (a table or an example of a manual),
    "protocol" (a program that does not know the device), "none". Empty if the driver does not state
    it.
    """
    words: dict[str, str] = {}
    for point in points_of(GROUP).select(name=driver):
        try:
            text = files(point.module.partition(".")[0]).joinpath(FILE).read_text("utf-8")
            table = json.loads(text)
        except (ImportError, OSError, TypeError, ValueError):
            continue  # a driver that is one module, a package without this file, or a broken file
        words |= table.get(driver, {})
    return words


def profile_of(driver: str, options: BaseModel) -> str:
    """Return the profile of a device with these options, as `evidence_of` names it."""
    for key in ("profile", "model"):
        if isinstance(named := getattr(options, key, None), str):
            return named
    return next(iter(evidence_of(driver)), driver)
