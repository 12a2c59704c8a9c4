"""Who each device said it is when the loop opened it, in a file that outlives the loop.

`piezod safe` writes to no other one.
"""

import json
from collections.abc import Mapping
from pathlib import Path

from piezod.daemon.durable import write_durably
from piezod.devices.interface import Identity


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
