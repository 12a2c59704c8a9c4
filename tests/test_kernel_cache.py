"""The cache of compiled kernels: whatever is wrong with it, the kernels are compiled again."""

import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

KERNEL = """
from piezod.jit import compiled
@compiled
def half(x):
    return {factor} * x
"""
CALL = "import tiny; print(tiny.half(6.0))"
KEPT = ("PATH", "LD_LIBRARY_PATH")


def cut_in_half(file: Path) -> None:
    """Leave the first half, as a full disk does."""
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def flip_a_bit(file: Path) -> None:
    """Change one bit in the middle."""
    found = bytearray(file.read_bytes())
    found[len(found) // 2] ^= 1
    file.write_bytes(found)


DAMAGES: tuple[Callable[[Path], object], ...] = (
    lambda file: file.write_bytes(b""),
    cut_in_half,
    flip_a_bit,
    lambda file: file.write_bytes(b"no pickle at all"),
    lambda file: file.write_bytes(b"cno_such_module\nno_such_class\n."),
    lambda file: file.write_bytes(os.urandom(file.stat().st_size)),
)
"""Ways in which a file of a cache is damaged: empty, half, one bit, text, foreign, noise."""


class Folder:
    """A module with one kernel, and a place for its cache."""

    def __init__(self, path: Path) -> None:
        self.cache = path / "cache"
        self._path = path
        self.run_as: tuple[str, ...] = ()
        self.write(0.5)

    def write(self, factor: float) -> None:
        """Write the module, with another kernel for each factor."""
        (self._path / "tiny.py").write_text(KERNEL.format(factor=factor))

    def files(self, suffix: str) -> list[Path]:
        """Return the files of the cache with a suffix."""
        return sorted(self.cache.rglob(f"*{suffix}"))

    def call(self, code: str = CALL, **environ: str) -> tuple[str, str]:
        """Call the kernel with 6 in a process of its own; return its output and its errors."""
        kept = {name: os.environ[name] for name in KEPT if name in os.environ}
        paths = os.pathsep.join((str(self._path), *sys.path))
        environ = {"NUMBA_CACHE_DIR": str(self.cache), "PYTHONPATH": paths} | environ
        done = subprocess.run(
            [*self.run_as, sys.executable, "-c", code],
            env=kept | environ, cwd=self._path, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout, done.stderr


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    """Return a folder with a kernel, which has never been called."""
    return Folder(tmp_path)


def test_first_call_says_that_it_compiles_and_the_second_nothing(folder: Folder) -> None:
    """Whoever waits for the first start is told why, and nobody else."""
    output, told = folder.call()
    assert (output, told.count("compiling")) == ("3.0\n", 1)

    assert folder.call() == ("3.0\n", "")


@pytest.mark.parametrize("suffix", [pytest.param(".nbi", marks=pytest.mark.stress), ".nbc"])
@pytest.mark.few(1)
def test_damaged_file_is_a_miss(folder: Folder, suffix: str) -> None:
    """A damaged file of the cache is named once, and replaced."""
    folder.call()
    (file,) = folder.files(suffix)
    cut_in_half(file)

    output, told = folder.call()
    assert (output, told.count(str(file))) == ("3.0\n", 1)
    assert folder.call() == ("3.0\n", "")


@pytest.mark.stress
@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_every_damage_is_a_miss(
    folder: Folder, suffix: str, damage: Callable[[Path], object]
) -> None:
    """No damage of a file of the cache ends a process or changes a result."""
    folder.call()
    (file,) = folder.files(suffix)
    damage(file)

    assert folder.call()[0] == "3.0\n"


def test_cache_of_another_version_is_silently_replaced(folder: Folder) -> None:
    """After an upgrade of numba or of Python's pickles nobody needs to know of the old files."""
    folder.call()
    (index,) = folder.files(".nbi")
    index.write_bytes(pickle.dumps("0.1") + b"what another version has written")

    output, told = folder.call()
    assert (output, str(folder.cache) in told) == ("3.0\n", False)


@pytest.mark.stress
def test_write_that_ended_between_its_two_files_does_not_matter(folder: Folder) -> None:
    """An index that is newer than the machine code that it names leads to no old machine code."""
    folder.call()
    (code,) = folder.files(".nbc")
    old = code.read_bytes()
    folder.write(0.25)
    assert folder.call()[0] == "1.5\n"
    code.write_bytes(old)

    assert folder.call()[0] == "1.5\n"


def test_without_a_place_for_a_cache_kernels_work(folder: Folder) -> None:
    """Where no folder can be written to, kernels are compiled each time, and the remedy is said."""
    Path(folder.cache.parent, "__pycache__").write_text("not a folder")

    for _ in range(2):
        output, told = folder.call(NUMBA_CACHE_DIR="", HOME="/dev/null")
        assert (output, told.count("NUMBA_CACHE_DIR")) == ("3.0\n", 1)


@pytest.mark.skipif(os.getuid() != 0, reason="only root becomes a user without an entry")
@pytest.mark.skipif(shutil.which("setpriv") is None, reason="needs setpriv")
def test_user_without_an_entry_has_no_folder_of_that_name(folder: Folder) -> None:
    """A user without an entry and without HOME gets no folder `~` where the process was started."""
    path = folder.cache.parent
    Path(path, "__pycache__").write_text("not a folder")
    for each in (path, *path.parents[:3]):
        each.chmod(each.stat().st_mode | 0o005)
    path.chmod(0o777)
    folder.run_as = ("setpriv", "--reuid", "54321", "--regid", "54321", "--clear-groups")

    output, told = folder.call(NUMBA_CACHE_DIR="")
    assert (output, told.count("NUMBA_CACHE_DIR")) == ("3.0\n", 1)
    assert not Path(path, "~").exists()


def test_cache_that_cannot_be_written_is_said_once(folder: Folder) -> None:
    """A folder that can no longer be written to ends nothing, as if a disk were full."""
    folder.call()
    (place,) = folder.cache.iterdir()
    # Not a folder without permission: tests may run as root.
    lose = f"import shutil; shutil.rmtree({str(place)!r}); open({str(place)!r}, 'x')"

    output, told = folder.call(f"import tiny; {lose}; print(tiny.half(6.0))")
    assert (output, told.count("cannot be")) == ("3.0\n", 1)


@pytest.mark.stress
def test_command_works_on_a_damaged_cache(tmp_path: Path) -> None:
    """A command of which every file of the cache is damaged says so once and does its work."""
    config = Path(__file__).parents[1] / "config" / "simulated.yaml"

    def check() -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [sys.executable, "-m", "piezod", "check", str(config)],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )

    first = check()
    for number, file in enumerate(sorted(tmp_path.rglob("*.nb[ic]"))):
        DAMAGES[number % len(DAMAGES)](file)
    damaged = check()

    assert damaged.stderr.count("cannot be used") == 1
    assert damaged.stdout.splitlines()[0] == first.stdout.splitlines()[0]
    assert check().stderr == ""
