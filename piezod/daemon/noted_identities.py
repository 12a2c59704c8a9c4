"""Who each device said it is when the loop opened it, in a file that outlives the loop.

`piezod safe` writes to no other one.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from piezod.daemon.durable import write_durably
from piezod.devices.interface import Identity

_NOT_TOLD: Final = frozenset({"unknown", "not told"})
"""What drivers say of what a device does not tell, or not when only its outputs are asked for."""


def is_same(found: Identity, noted: Identity) -> bool:
    """Tell whether nothing speaks against two being one, by maker, model and serial number."""
    return all(
        a == b or not _NOT_TOLD.isdisjoint({a, b})
        for a, b in zip(found[:3], noted[:3], strict=True)
    )


def note_identities(path: Path, identities: Mapping[str, Identity]) -> None:
    """Note who each device is, by its name in the configuration.

    Raises:
        OSError: If the file cannot be written.
    """
    write_durably(path, json.dumps(identities, indent=1).encode())


def noted_identities(path: Path) -> dict[str, Identity]:
    """Return who each device was; nobody where nobody noted anything that can be read.

    Raises:
        OSError: If the file is there and cannot be read.
    """
    try:
        document = json.loads(path.read_bytes())
        return {name: Identity(*map(str, who)) for name, who in document.items()}
    except (FileNotFoundError, ValueError, TypeError, AttributeError):
        return {}
