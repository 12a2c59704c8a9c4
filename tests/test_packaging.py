"""Properties of the installed distribution."""

import sys
import tomllib
from importlib.metadata import entry_points, version
from importlib.resources import files
from pathlib import Path
from subprocess import run

import pytest

import piezod
from piezod.devices.interface import DriverPlugin

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]


def test_version_is_that_of_the_project_file() -> None:
    """The project file is the only source of the version."""
    assert piezod.__version__ == version("piezod") == PROJECT["version"]


def test_unknown_attribute_is_named() -> None:
    """The lazy lookup of the version does not hide other missing attributes."""
    with pytest.raises(AttributeError, match="module 'piezod' has no attribute 'versoin'"):
        piezod.versoin  # type: ignore[attr-defined]  # noqa: B018 - the mistake under test


@pytest.mark.parametrize("package", ["piezod", "piezod_drivers"])
def test_package_ships_its_types(package: str) -> None:
    """Type checkers use the annotations of an installed package only if it has a py.typed file."""
    assert files(package).joinpath("py.typed").is_file()


def test_simulated_driver_is_a_plugin() -> None:
    """The entry point refers to the plug-in."""
    (point,) = entry_points(group="piezod.drivers", name="simulated")

    assert isinstance(point.load(), DriverPlugin)


def test_command_is_callable() -> None:
    """The entry point of the script refers to a function."""
    (point,) = entry_points(group="console_scripts", name="piezod")

    assert callable(point.load())


@pytest.mark.parametrize(
    "module", ["piezod", "piezod.errors", "piezod.units", "piezod.devices.registry"]
)
def test_import_is_light(module: str) -> None:
    """The modules of `piezod safe` import neither numpy nor numba, which take long."""
    code = f"import sys, {module}; print(*{{'numpy', 'numba', 'pydantic'}} & set(sys.modules))"

    assert (
        run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "\n"
    )
