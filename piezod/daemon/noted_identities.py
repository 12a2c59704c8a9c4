"""The identity of each device when the loop opened it, in a file that outlives the loop.

`piezod safe` writes only to devices with these identities.
"""

import json
from collections.abc import Mapping
from pathlib import Path

from piezod.daemon.durable import write_durably
from piezod.devices.interface import Identity


def note_identities(path: Path, identities: Mapping[str, Identity]) -> None:
    """Store the identity of each device, by its name in the configuration.

    Raises:
        OSError: If the file cannot be written.
    """
    write_durably(path, json.dumps(identities, indent=1).encode())


def noted_identities(path: Path) -> dict[str, Identity]:
    """Return the stored identities; none without a valid file.

    Raises:
        OSError: If the file exists and cannot be read.
    """
    try:
        document = json.loads(path.read_bytes())
        return {name: Identity(*map(str, who)) for name, who in document.items()}
    except (FileNotFoundError, NotADirectoryError, ValueError, TypeError, AttributeError):
        return {}
