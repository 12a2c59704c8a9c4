"""Cost of a step of exported C beside that of the loop's own compiled step, in one run.

Run it with `python benchmarks/bench_exported_code.py`; it needs gcc. Both run over the same
positions on one core, in rounds that alternate; the medians of the processor time are printed.
"""

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import process_time_ns

import numpy as np

from piezod.hysteresis.memory import FloatArray
from piezod.inverse.exported_code import exported_code
from piezod.inverse.loaded_model import LoadedModel, load_model
from tests.inverse.models import signals
from tests.inverse.test_exported_code import of_the_loop

MODEL = Path(__file__).parents[1] / "config" / "models" / "simulated-stack.yaml"
SAMPLES, ROUNDS = 200_000, 5
RUN = """
#include "axis.c"
void run(const double *x, double *y, int n) {
  static axis_state s;
  axis_reset(&s);
  for (int i = 0; i < n; i++) y[i] = axis_drive_v(&s, x[i]);
}
"""


def compiled(model: LoadedModel, folder: Path, level: str) -> Callable[[FloatArray], object]:
    """Return a function that runs exported C over positions in µm."""
    code = exported_code(model, "c", folder / "axis.c")
    (folder / "axis.c").write_text(code, encoding="utf-8")
    (folder / "run.c").write_text(RUN, encoding="utf-8")
    library = folder / f"axis{level}.so"
    command = ["gcc", level, "-shared", "-fPIC", "-o", str(library), str(folder / "run.c")]
    subprocess.run(command, check=True)  # noqa: S603 - the compiler of this machine
    run = ctypes.CDLL(str(library)).run

    def call(position_um: FloatArray) -> None:
        drive_v = np.empty_like(position_um)
        pointers = (each.ctypes.data_as(ctypes.c_void_p) for each in (position_um, drive_v))
        run(*pointers, ctypes.c_int(position_um.size))

    return call


def main() -> None:
    """Print a row for each signal."""
    if shutil.which("gcc") is None:
        print("exported code: needs gcc")
        return
    model = load_model(MODEL)
    with TemporaryDirectory() as name:
        runs: dict[str, Callable[[FloatArray], object]] = {
            **{f"C {level}": compiled(model, Path(name), level) for level in ("-O2", "-O3")},
            "loop": lambda position_um: of_the_loop(model, position_um),
        }
        print("ns a step of stops with creep:", ", ".join(runs))
        for signal, unit in signals(SAMPLES).items():
            position_um = unit * model.position_range_um[1]
            times: dict[str, list[float]] = {kind: [] for kind in runs}
            for _ in range(ROUNDS):
                for kind, run in runs.items():
                    start_ns = process_time_ns()
                    run(position_um)
                    times[kind].append((process_time_ns() - start_ns) / SAMPLES)
            row = "  ".join(f"{median(each):7.1f}" for each in times.values())
            print(f"{signal:16} {row}")


if __name__ == "__main__":
    main()
