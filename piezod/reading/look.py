"""The process that looks through an HDF5 file of unknown origin before another one reads it.

On a damaged file HDF5 may loop for ever, take all memory, or crash; then this process does. What
it finds is its output, and its exit code is 1; without output and with 0 the file may be read.
"""

import sys
from pathlib import Path
from typing import Final

from piezod.errors import DataError
from piezod.reading.opened import FOREIGN, LOOK_WITHIN_S, open_recording
from piezod.resource_limits import bound

MOST_BYTES: Final = 1_000_000_000
"""Most memory for a look."""


def main() -> int:
    """Look through the file that the first argument names; the second says who wrote it."""
    bound(MOST_BYTES, LOOK_WITHIN_S)
    try:
        open_recording(Path(sys.argv[1]), foreign=FOREIGN in sys.argv[2:]).close()
    except (DataError, OSError) as error:
        sys.stdout.buffer.write(str(error).encode(errors="surrogateescape"))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
