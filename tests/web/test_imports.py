import subprocess
import sys

SERVER = "'starlette', 'uvicorn', 'websockets', 'piezod.web'"
HEAVY = "'fastapi', 'h5py', 'numba', 'numpy', 'piezod.daemon', 'scipy'"


def imported(module: str, names: str) -> str:
    """Return which of some modules another one imports, as text."""
    code = f"import sys, {module}; print({{{names}}} & sys.modules.keys())"
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout


def test_other_verbs_start_without_the_server() -> None:
    """The command line imports the server of the page for `piezod web` only."""
    assert imported("piezod.cli.main", SERVER) == "set()\n"


def test_server_is_small() -> None:
    """The server of the page imports nothing of the daemon, and no numeric library."""
    assert imported("piezod.web.server", HEAVY) == "set()\n"
