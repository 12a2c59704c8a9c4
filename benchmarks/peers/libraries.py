"""Methods of libraries by others, each in a process of the environment of `make bench-peers`."""

import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.peers.method import Row, Series
from benchmarks.peers.worker import ABOUT

ROOT: Final = Path(__file__).parents[2]
PYTHON: Final = ROOT / "build" / "bench-peers" / "bin" / "python"
"""Interpreter of the environment that `make bench-peers` sets up."""
LIBRARY_METHODS: Final = ABOUT
ONE_THREAD: Final = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""So that durations are those of one core, as for the other methods."""


def row_of_library(name: str, record: Series, test: Series, *, without_offset: bool) -> Row:
    """Return the row of a method of a library; its `failure` states why nothing was measured."""
    if not PYTHON.exists():
        return Row(name, failure=f"{PYTHON} is missing; run `make bench-peers`")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "records.npz"
        series = {"record": record, "test": test}
        arrays = {f"{k}_{n}": v for k, each in series.items() for n, v in vars(each).items()}
        np.savez(path, without_offset=np.array(without_offset), **arrays)
        done = subprocess.run(  # noqa: S603 - our own program
            [str(PYTHON), "-m", "benchmarks.peers.worker", name, str(path)],
            cwd=ROOT,
            env={**os.environ, **ONE_THREAD},
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode:
        return Row(name, failure=(done.stderr.strip().splitlines() or ["no message"])[-1])
    return Row.from_document(json.loads(done.stdout.splitlines()[-1]))
