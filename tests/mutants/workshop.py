"""A folder in which mutmut changes one module, and what it found there."""

import ast
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from tests.mutants.modules import Module

ROOT: Final = Path(__file__).parents[2]
MUTMUT: Final = Path(sys.executable).with_name("mutmut")
LONGEST_S: Final = 10.0
"""A run of the tests that takes longer than this never ends: some mutants loop for ever."""
KILLED: Final = ("killed", "timeout")
SETTINGS: Final = """
[tool.mutmut]
source_paths = [{path}]
also_copy = ["piezod", "docs"]
pytest_add_cli_args_test_selection = {tests}
pytest_add_cli_args = {options}
timeout_constant = {longest_s}
timeout_multiplier = 1.0
"""


class Change(NamedTuple):
    """A mutant, without the number that mutmut gave it."""

    function: str  #: The function, with its class.
    before: str  #: The lines that the mutant changes.
    after: str  #: The changed lines.

    def __str__(self) -> str:
        """Return the change as people read it."""
        return f"in {self.function}:\n    - {self.before}\n    + {self.after}"


class Findings(NamedTuple):
    """Result of all mutants of a module."""

    total: int  #: How many there are.
    survivors: list[Change]  #: Those that no test noticed.


def findings(name: str, module: Module) -> Findings:
    """Run the tests of a module for each of its mutants.

    Raises:
        RuntimeError: If mutmut failed, for example because a test fails without a mutant.
    """
    folder = _made(name, module)
    _mutmut(folder, "run")
    _mutmut(folder, "export-cicd-stats")
    stats = json.loads((folder / "mutants" / "mutmut-cicd-stats.json").read_text())
    names = _survivors(_mutmut(folder, "results"))
    survivors = [change_of(name, _mutmut(folder, "show", name)) for name in names]
    return Findings(stats["total"], survivors)


def with_functions(source: str) -> str:
    """Return a source in which each property is made from a method with another name.

    mutmut does not change functions that have a decorator.
    """
    lines = source.splitlines()
    for node in reversed(list(_properties(source))):
        lines.insert(node.end_lineno or 0, f"    {node.name} = property(get_{node.name})")
        lines[node.lineno - 1] = lines[node.lineno - 1].replace("def ", "def get_", 1)
        del lines[node.lineno - 2]
    return "\n".join([*lines, ""])


def change_of(mutant: str, shown: str) -> Change:
    """Return what a mutant changes, from its name and the difference that mutmut shows."""
    mangled = mutant.rpartition(".")[2].rpartition("__mutmut_")[0]
    function = mangled.removeprefix("xǁ").replace("ǁ", ".").removeprefix("x_")
    before, after = (
        "\n".join(line[1:].strip() for line in shown.splitlines() if line[:1] == sign != line[1:2])
        for sign in "-+"
    )
    return Change(function.replace(".get_", "."), before, after)


def _properties(source: str) -> Iterator[ast.FunctionDef]:
    """Yield the properties of all classes, in their order."""
    for part in ast.parse(source).body:
        for node in part.body if isinstance(part, ast.ClassDef) else ():
            if isinstance(node, ast.FunctionDef) and [
                ast.unparse(each) for each in node.decorator_list
            ] == ["property"]:
                yield node


def _made(name: str, module: Module) -> Path:
    """Make the folder: the package, its tests, the pages that they read, and the settings."""
    folder = ROOT / "build" / "mutants" / "work" / name
    shutil.rmtree(folder, ignore_errors=True)
    for part in ("piezod", "tests", "docs"):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
    changed = folder / module.path
    changed.write_text(with_functions(changed.read_text()))
    settings = SETTINGS.format(
        path=json.dumps(module.path),
        tests=json.dumps(module.tests),
        options=json.dumps(
            ["-p", "no:cacheprovider", *map("--deselect={}".format, module.left_out)]
        ),
        longest_s=LONGEST_S,
    )
    (folder / "pyproject.toml").write_text((ROOT / "pyproject.toml").read_text() + settings)
    return folder


def _mutmut(folder: Path, *arguments: str) -> str:
    """Run mutmut in the folder; return what it printed."""
    # CI: the property tests draw the same examples for each mutant.
    done = subprocess.run(
        [MUTMUT, *arguments],
        cwd=folder,
        env={**os.environ, "CI": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"mutmut {arguments[0]} failed in {folder}:\n{done.stdout}{done.stderr}")
    return done.stdout


def _survivors(results: str) -> Iterator[str]:
    """Yield the names of the mutants that were not killed."""
    for line in results.splitlines():
        mutant, _, status = line.strip().rpartition(": ")
        if status not in KILLED:
            yield mutant
