"""Adds compiled modules to a wheel, if PIEZOD_COMPILE is 1: `make compiled`.

The modules of `tool.piezod.compiled` in pyproject.toml are compiled by mypyc, from a copy in a
temporary folder. The wheel has them beside their sources, which Python then leaves alone. Without
PIEZOD_COMPILE a wheel is pure Python, and needs no compiler.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_SETUP = """
from mypyc.build import mypycify
from setuptools import setup

extensions = mypycify({arguments!r}, opt_level="3", debug_level="0", group_name="piezod")
setup(name="piezod-compiled", packages=[], ext_modules=extensions)
"""
_TYPES = "[mypy]\nplugins = pydantic.mypy\nignore_missing_imports = True\n"


class CompiledHook(BuildHookInterface[Any]):
    """Compiles modules for a wheel."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Return what a build in an environment of its own needs, to know all types."""
        if not _wanted():
            return []
        project = _project(Path(self.root))
        return [*project["project"]["dependencies"], "mypy>=2.4.1", "setuptools>=65"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and add the modules to the wheel."""
        if not _wanted() or version == "editable":
            return
        self._folder = tempfile.TemporaryDirectory(prefix="piezod-compiled-")
        compiled = compile_modules(Path(self.root), Path(self._folder.name))
        build_data["pure_python"], build_data["infer_tag"] = False, True
        build_data["force_include"].update(compiled)

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002 - hatchling's
        """Remove the temporary folder."""
        if _wanted() and version != "editable":
            self._folder.cleanup()


def compile_modules(root: Path, folder: Path) -> dict[str, str]:
    """Compile into a folder; return the place in a wheel of each file.

    Args:
        root: The folder of pyproject.toml.
        folder: An empty folder.
    """
    for package in ("piezod", "drivers/piezod_drivers"):
        without = shutil.ignore_patterns("__pycache__", "static", "templates")
        shutil.copytree(root / package, folder / Path(package).name, ignore=without)
    modules = _project(root)["tool"]["piezod"]["compiled"]
    (folder / "types.ini").write_text(_TYPES, encoding="utf-8")
    setup = _SETUP.format(arguments=["--config-file", "types.ini", *modules])
    (folder / "setup.py").write_text(setup, encoding="utf-8")
    command = [sys.executable, "setup.py", "--quiet", "build_ext", "--inplace"]
    # A product and a sum are rounded one by one, as Python does: some compilers fuse them. Calls of
    # the interpreter need no table.
    flags = {"CFLAGS": f"{os.environ.get('CFLAGS', '')} -ffp-contract=off -fno-plt"}
    subprocess.run(command, cwd=folder, check=True, env=os.environ | flags)  # noqa: S603 - our own words
    # What is built lies below build/ too.
    found = [path.relative_to(folder) for path in folder.rglob("*.so")]
    return {str(folder / path): str(path) for path in found if path.parts[0] != "build"}


def _wanted() -> bool:
    return os.environ.get("PIEZOD_COMPILE") == "1"


def _project(root: Path) -> dict[str, Any]:
    return tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
