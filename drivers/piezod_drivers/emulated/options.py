"""Options of a rig in another process."""

from pathlib import Path
from typing import Annotated, Final

from pydantic import Field, StringConstraints

from piezod.config.fields import ConfigModel, Quantity
from piezod.devices.emulation.places import own_folder

DEFAULT_SOCKET: Final = "rig.sock"


class EmulatedOptions(ConfigModel):
    """Options of a rig in another process."""

    socket: Annotated[str, StringConstraints(min_length=1, max_length=100)] = Field(
        default=DEFAULT_SOCKET,
        description="Socket of the rig: an absolute path, or a name in the folder for sockets, "
        "$XDG_RUNTIME_DIR/piezod or else ${TMPDIR:-/tmp}/piezod-UID.",
    )
    deadline_ms: Annotated[float, Quantity(0.1, 1000, "ms")] = Field(
        default=5.0, description="Longest wait for each reply, ms."
    )


def socket_path(socket: str) -> Path:
    """Return the path of a socket: an absolute path, or a name in the folder for sockets."""
    return own_folder() / socket
