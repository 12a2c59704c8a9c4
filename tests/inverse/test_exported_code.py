"""Models as C and MATLAB, compiled and run by what this machine has."""

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pytest
from numba import njit
from pydantic import Field

from piezod.config.model_file import ModelFile, PathConfig
from piezod.control.law.kernels import new_kernel
from piezod.errors import ModelError
from piezod.hysteresis.memory import FloatArray
from piezod.inverse.exported_code import exported_code
from piezod.inverse.feedforward import Feedforward
from piezod.inverse.loaded_model import LoadedModel
from tests.inverse.models import MODELS, changed, loaded, signals

STRICT: Final = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")


class Target(NamedTuple):
    """How C becomes a program, and how it runs."""

    compiler: str
    options: tuple[str, ...] = ()
    runner: tuple[str, ...] = ()


SANITIZED: Final = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g")
TARGETS: Final = {
    "gcc-O0": Target("gcc", ("-O0", *STRICT)),
    "gcc-O3": Target("gcc", ("-O3", *STRICT)),
    "gcc-sanitized": Target("gcc", ("-O1", *SANITIZED)),
    "gcc-float": Target("gcc", ("-O2", "-DNAME_FLOAT", *STRICT, "-Wdouble-promotion")),
    "clang-O0": Target("clang", ("-O0", *STRICT)),
    "clang-O3": Target("clang", ("-O3", *STRICT)),
    "clang-sanitized": Target("clang", ("-O1", *SANITIZED)),
    "arm": Target("arm-linux-gnueabihf-gcc", ("-O2", "-static"), ("qemu-arm",)),
    "arm-float": Target(
        "arm-linux-gnueabihf-gcc", ("-O2", "-static", "-DNAME_FLOAT"), ("qemu-arm",)
    ),
}
SHORT: Final = ["gcc-O3", "gcc-float"]


def require(*programs: str) -> None:
    """Skip a test if a program is missing."""
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"needs {program}")


def code_of(model: LoadedModel, folder: Path, language: str = "c") -> Path:
    """Write a model as code; return the file."""
    file = folder / ("name.c" if language == "c" else "name.m")
    file.write_text(exported_code(model, language, file), encoding="utf-8")
    return file


def run(*command: object, cwd: Path) -> str:
    """Run a program, which must succeed; return its output."""
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def self_tested(name: str, target: Target, folder: Path) -> str:
    """Compile the self-test of a model and run it; return what it prints."""
    require(target.compiler, *target.runner)
    file = code_of(loaded(MODELS[name]()), folder)
    run(target.compiler, "-DSELF_TEST", *target.options, "-o", "test", file, cwd=folder)
    return run(*target.runner, folder / "test", cwd=folder)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("target", SHORT)
@pytest.mark.few(6)
def test_c_passes_its_own_test(name: str, target: str, tmp_path: Path) -> None:
    """The program says that it has passed, and that its memory was full."""
    said = self_tested(name, TARGETS[target], tmp_path)

    assert said.startswith("passed")
    assert " 0 pairs" not in said


@pytest.mark.stress
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("target", TARGETS)
def test_c_passes_its_own_test_everywhere(name: str, target: str, tmp_path: Path) -> None:
    """So it does with each compiler, optimised or not, with sanitizers, and on an ARM."""
    assert self_tested(name, TARGETS[target], tmp_path).startswith("passed")


@pytest.mark.parametrize("name", MODELS)
def test_self_test_finds_a_wrong_number(name: str, tmp_path: Path) -> None:
    """A model with another weight does not pass the test of the first one."""
    require("gcc")
    file = code_of(loaded(MODELS[name]()), tmp_path)
    text = file.read_text(encoding="utf-8")
    array = f"{'factor[20]' if 'factor[20]' in text else 'coefficient[24]'} = {{\n    R("
    file.write_text(text.replace(array, f"{array}1e-6 + "), encoding="utf-8")
    run("gcc", "-DSELF_TEST", "-o", "test", file, cwd=tmp_path)

    assert subprocess.run([tmp_path / "test"], capture_output=True, check=False).returncode == 1


@pytest.mark.stress
@pytest.mark.parametrize("name", MODELS)
def test_matlab_passes_its_own_test(name: str, tmp_path: Path) -> None:
    """Octave runs the MATLAB code, which agrees with the loop."""
    require("octave-cli")
    code_of(loaded(MODELS[name]()), tmp_path, "matlab")
    said = run("octave-cli", "--norc", "--eval", "name('self-test');", cwd=tmp_path)

    assert said.startswith("passed")


def compared(model: LoadedModel, folder: Path, count: int, options: Sequence[str] = ()) -> float:
    """Return the worst difference between C and the loop's step, as a share of the range."""
    code_of(model, folder)
    real = np.float32 if options else np.float64
    (folder / "library.c").write_text(
        '#include "name.c"\n'
        "void run(const REAL *x, REAL *y, int n) {\n"
        "  static name_state s;\n  int i;\n  name_reset(&s);\n"
        "  for (i = 0; i < n; i++) y[i] = name_drive_v(&s, x[i]);\n}\n"
    )
    kind = "float" if options else "double"
    command = ("gcc", "-O2", "-shared", "-fPIC", f"-DREAL={kind}", *options, "-o", "name.so")
    run(*command, "library.c", cwd=folder)
    library = ctypes.CDLL(str(folder / "name.so"))
    stage, worst = model.model_at(model.rate_hz), 0.0
    for unit in signals(count).values():
        position_um = np.ascontiguousarray(stage.position_um.from_unit(unit), dtype=real)
        drive_v = np.empty_like(position_um)
        library.run(
            position_um.ctypes.data_as(ctypes.c_void_p),
            drive_v.ctypes.data_as(ctypes.c_void_p),
            ctypes.c_int(position_um.size),
        )
        expected_v = of_the_loop(model, position_um.astype(np.float64))
        worst = max(worst, float(np.max(np.abs(drive_v - expected_v))) / stage.drive_v.width)
    return worst


@njit
def _run(step, constant, target, zeroed, commands, drives):  # type: ignore[no-untyped-def]
    for k in range(commands.size):
        drives[k] = step(*constant, target, 0.0, 1.0, commands[k], 1.0, zeroed, 0.0, 1.0)


def of_the_loop(model: LoadedModel, position_um: FloatArray) -> FloatArray:
    """Return the voltages of the loop's own compiled step, in V."""
    stage = model.model_at(model.rate_hz)
    state = Feedforward(stage, model.limits, 1.0 / model.rate_hz, model.rest_v).state
    kernel = new_kernel(stage.form, stage.weights.copy(), state)
    drives = np.empty_like(position_um)
    commands = stage.position_um.to_unit(position_um)
    step = kernel.step
    _run(step.func, step.args, stage.weights, state.zeroed, commands, drives)  # type: ignore[attr-defined]
    return stage.drive_v.from_unit(drives)


@pytest.mark.stress
@pytest.mark.parametrize("name", MODELS)
def test_c_agrees_with_the_loop_for_a_million_steps(name: str, tmp_path: Path) -> None:
    """Sines, decays, walks, noise, NaN, positions out of range and a full memory: to 1e-12."""
    require("gcc")

    assert compared(loaded(MODELS[name]()), tmp_path, 1_000_000) < 1e-12


@pytest.mark.stress
@pytest.mark.parametrize("name", ["stops", "stops-creep"])
def test_float_agrees_with_the_loop_for_a_million_steps(name: str, tmp_path: Path) -> None:
    """Single precision is enough for stops, with creep over minutes, too: to 1e-5."""
    require("gcc")

    assert compared(loaded(MODELS[name]()), tmp_path, 1_000_000, ["-DNAME_FLOAT"]) < 1e-5


class _LaterFile(ModelFile):
    """A model file of a later version."""

    surface_exponent: float = Field(default=1.0, description="A part that code does not have.")


class _LaterPath(PathConfig):
    """Its part that relaxes along the path."""

    memory: float = Field(default=1.0, description="Another one.")


def test_part_that_code_does_not_have_is_refused_by_name() -> None:
    """What the generator does not know is never left out silently; a default changes nothing."""
    model = loaded(MODELS["surface"]())
    fields = model.file.model_dump()
    model.file = _LaterFile.model_validate(fields)
    exported_code(model, "c", Path("name.c"))

    model.file = model.file.model_copy(update={"surface_exponent": 1.2})
    with pytest.raises(ModelError, match="surface_exponent"):
        exported_code(model, "c", Path("name.c"))

    path = changed("path").surface_path
    assert path is not None
    model.file = changed("path", surface_path=_LaterPath(**path.model_dump(), memory=2.0))
    with pytest.raises(ModelError, match=r"surface_path\.memory"):
        exported_code(model, "matlab", Path("name.m"))


def test_texts_of_a_model_file_are_no_code() -> None:
    """A name of a record with the end of a remark, or with a line end, stays in the remark."""
    model = loaded(MODELS["stops"]())
    source = model.file.source.model_copy(update={"file": "a*/int evil;/*.csv\nevil = 1;\u2028b"})
    model.file = model.file.model_copy(update={"source": source})

    assert "*/int evil" not in exported_code(model, "c", Path("name.c"))
    lines = exported_code(model, "matlab", Path("name.m")).splitlines()
    assert [line for line in lines if "evil" in line and not line.startswith("%")] == []
