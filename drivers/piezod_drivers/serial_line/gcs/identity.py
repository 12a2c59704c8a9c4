"""Reads the identity of a PI controller."""

from piezod.devices.interface import UNKNOWN, Identity


def identity_of(reply: bytes) -> Identity:
    """Read the reply to `*IDN?`: maker, model, serial number and firmware, separated by commas.

    Missing parts are "unknown". PI uses code page 1252. The maker's name may contain commas, so the
    reply is split from its end.
    """
    parts = [part.strip() for part in reply.decode("cp1252", "replace").rsplit(",", 3)]
    if len(parts) < 4:
        model, *rest = (part for part in parts if part) if any(parts) else (UNKNOWN,)
        parts = ["Physik Instrumente", model, *rest]
    parts += [""] * (4 - len(parts))
    return Identity(*(part or UNKNOWN for part in parts))
