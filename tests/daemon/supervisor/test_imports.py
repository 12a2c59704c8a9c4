"""The libraries that supervisor and rescuer load: all at the start, and none that is large."""

import subprocess
import sys

import pytest

LARGE = {"httpx", "jinja2", "matplotlib", "numba", "pygments", "rich", "scipy"}
CODE = """
import sys
import {module}
print(sorted({large} & set(sys.modules)))
"""


@pytest.mark.parametrize(
    ("module", "large"),
    [
        ("piezod.daemon.supervisor.supervisor", LARGE),
        ("piezod.daemon.safe.rescuer", LARGE | {"fastapi", "h5py", "numpy", "uvicorn"}),
    ],
)
def test_large_libraries_stay_out(module: str, large: set[str]) -> None:
    """They need memory that is never used, and the rescuer works without numpy."""
    code = CODE.format(module=module, large=large)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)

    assert done.stdout == "[]\n"


def test_rich_can_be_imported_after_the_log() -> None:
    """The log leaves rich out of structlog alone."""
    code = "import piezod.daemon.logging, rich.console; print(rich.console.Console)"

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)

    assert done.stdout == b"<class 'rich.console.Console'>\n"
