"""The registry of drivers: found by entry point, imported on demand, ambiguous never."""

from collections.abc import Callable
from pathlib import Path

import pytest

from piezod.devices import registry
from piezod.errors import RegistryError

Install = Callable[..., None]

GOOD_PLUGIN = """
from pydantic import BaseModel
from piezod.devices.interface import DriverPlugin
PLUGIN = DriverPlugin(NAME, "for tests", BaseModel, lambda options, axes, seed: None, False)
"""


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Return a function that puts a distribution with one driver where Python finds it."""

    def put(distribution: str, driver: str, module: str, source: str) -> None:
        (tmp_path / f"{module}.py").write_text(source)
        info = tmp_path / f"{distribution}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Name: {distribution}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[piezod.drivers]\n{driver} = {module}:PLUGIN\n")
        monkeypatch.syspath_prepend(tmp_path)

    return put


def test_installed_driver_is_listed() -> None:
    """The simulated rig ships with piezod."""
    assert "simulated" in registry.names()


def test_names_are_sorted_and_nothing_is_imported(install: Install) -> None:
    """Listing names tells of a broken plug-in too, since it imports none."""
    install("a-maker", "a_broken_stage", "stage_that_raises", "raise OSError('no such bus')")

    names = registry.names()

    assert "a_broken_stage" in names
    assert tuple(sorted(names)) == names


def test_driver_of_another_distribution_is_loaded(install: Install) -> None:
    """Any installed distribution can bring a driver."""
    install("a-maker", "stage", "good_stage", f"NAME = 'stage'{GOOD_PLUGIN}")

    assert registry.load("stage").summary == "for tests"


def test_unknown_name_lists_the_known_ones() -> None:
    """A misspelt name is answered with the names there are."""
    with pytest.raises(
        RegistryError, match=r"unknown driver 'simulatde', known drivers: .*simulated"
    ):
        registry.load("simulatde")


def test_unknown_name_when_nothing_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no driver is installed the error says so."""
    monkeypatch.setattr(registry, "GROUP", "a.group.that.nobody.uses")

    with pytest.raises(RegistryError, match="known drivers: none is installed"):
        registry.load("simulated")


def test_duplicate_name_is_refused(install: Install) -> None:
    """Of two drivers with one name neither is chosen in silence."""
    install("b-maker", "stage", "stage_b", f"NAME = 'stage'{GOOD_PLUGIN}")
    install("a-maker", "stage", "stage_a", f"NAME = 'stage'{GOOD_PLUGIN}")

    with pytest.raises(
        RegistryError, match=r"'stage' is provided by a-maker 1\.0 and b-maker 1\.0"
    ):
        registry.load("stage")
    assert registry.names().count("stage") == 1


@pytest.mark.parametrize("source", ["raise OSError('no such bus')", "import no_such_module", ""])
def test_plugin_that_cannot_be_imported_names_its_distribution(
    install: Install, source: str
) -> None:
    """Whatever goes wrong during an import, the error tells whose plug-in it is."""
    install("a-maker", "stage", f"stage_{len(source)}", source)

    with pytest.raises(RegistryError, match=r"of a-maker 1\.0\) cannot be imported: "):
        registry.load("stage")


def test_plugin_of_another_type_is_refused(install: Install) -> None:
    """The entry point must lead to a DriverPlugin."""
    install("a-maker", "stage", "stage_of_text", "PLUGIN = 'a text'")

    with pytest.raises(RegistryError, match="is a str, not a DriverPlugin"):
        registry.load("stage")


def test_plugin_of_another_name_is_refused(install: Install) -> None:
    """A driver has one name."""
    install("a-maker", "stage", "stage_by_alias", f"NAME = 'alias'{GOOD_PLUGIN}")

    with pytest.raises(RegistryError, match="calls itself 'alias': the two names must agree"):
        registry.load("stage")
