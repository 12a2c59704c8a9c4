"""Files shipped beside the code: the example configurations, and the files of the service."""

from pathlib import Path

import piezod


def shipped(name: str) -> Path:
    """Return a folder of shipped files: in the wheel, or beside the package in a checkout.

    Args:
        name: `config` or `systemd`.
    """
    package = Path(piezod.__file__).parent
    in_wheel = package / "data" / name
    return in_wheel if in_wheel.is_dir() else package.parent / name
