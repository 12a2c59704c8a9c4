"""How large recordings may become."""

import shutil
from math import inf
from pathlib import Path
from typing import Final, NamedTuple

_RESERVE_BYTES: Final = 500_000_000
_RESERVE_SHARE: Final = 0.05


class RecordingLimits(NamedTuple):
    """Limits of a recording and of all recordings of a stage."""

    file_s: float = inf  #: Time after which a recording goes on in another file, in s.
    file_bytes: float = inf  #: Size after which it does.
    total_bytes: float = inf  #: Size of all recordings; the oldest are removed.


def no_room(folder: Path) -> str:
    """Return why a disk is too full for a recording, or "".

    500 MB or 5 % of the disk, whichever is more, are kept free for other uses.
    """
    usage = shutil.disk_usage(folder)
    reserve = max(_RESERVE_BYTES, _RESERVE_SHARE * usage.total)
    if usage.free >= reserve:
        return ""
    return (
        f"{usage.free / 1e6:.0f} MB are free in {folder}, and {reserve / 1e6:.0f} MB must stay "
        "free; delete recordings"
    )
