"""Files that are shipped beside the code: example configurations, and those of the service."""

from pathlib import Path

import piezod


def shipped(name: str) -> Path:
    """Return a folder of files: that in the wheel, or in a checkout the one beside the package.

    Args:
        name: `config` or `systemd`.
    """
    package = Path(piezod.__file__).parent
    in_wheel = package / "data" / name
    return in_wheel if in_wheel.is_dir() else package.parent / name
