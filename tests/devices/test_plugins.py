"""Plug-ins of both kinds: found by entry point, imported on demand, never ambiguous."""

import os
from collections.abc import Callable
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from piezod.devices import emulators, registry
from piezod.errors import RegistryError

Install = Callable[..., None]


class Kind(NamedTuple):
    """A kind of plug-in."""

    called: str  #: Its name in messages.
    lookup: Any  #: The module that finds it.
    known: str  #: Name of an installed one.
    type_name: str  #: Its class.
    good: str  #: Source of a valid one, after its `NAME`.


DRIVER = Kind(
    "driver",
    registry,
    "simulated",
    "DriverPlugin",
    """
from pydantic import BaseModel
from piezod.devices.interface import DriverPlugin
PLUGIN = DriverPlugin(NAME, "for tests", BaseModel, lambda options, axes, seed: None, False)
""",
)
EMULATOR = Kind(
    "emulator",
    emulators,
    "pi-gcs2",
    "EmulatorPlugin",
    """
from piezod.devices.emulation.emulator import EmulatorPlugin
PLUGIN = EmulatorPlugin(NAME, "for tests", "serial", lambda bench, serial: None)
""",
)


@pytest.fixture(params=[DRIVER, EMULATOR], ids=lambda kind: kind.called)
def kind(request: pytest.FixtureRequest) -> Kind:
    """Return each kind of plug-in in turn."""
    found: Kind = request.param
    return found


@pytest.fixture
def install(kind: Kind, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Return a function that installs a distribution with one plug-in."""

    def put(distribution: str, name: str, module: str, source: str) -> None:
        module = f"{kind.called}_{module}"
        (tmp_path / f"{module}.py").write_text(source)
        info = tmp_path / f"{distribution}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Name: {distribution}\nVersion: 1.0\n")
        group = kind.lookup.GROUP
        (info / "entry_points.txt").write_text(f"[{group}]\n{name} = {module}:PLUGIN\n")
        monkeypatch.syspath_prepend(tmp_path)

    return put


def test_installed_drivers_are_listed(kind: Kind) -> None:
    """The plug-ins of piezod itself are listed."""
    assert kind.known in kind.lookup.names()


def test_names_are_sorted_and_nothing_is_imported(kind: Kind, install: Install) -> None:
    """A broken plug-in is listed too, because listing imports nothing."""
    install("a-maker", "a_broken_stage", "that_raises", "raise OSError('no such bus')")

    names = kind.lookup.names()

    assert "a_broken_stage" in names
    assert tuple(sorted(names)) == names


def test_search_is_repeated_after_an_installation_only(
    kind: Kind, install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plug-in that is installed while the process runs is listed; else nothing is read again."""
    install("a-maker", "early", "early", "")
    searches: list[str] = []

    def search(group: str) -> EntryPoints:
        searches.append(group)
        return entry_points(group=group)

    monkeypatch.setattr("piezod.devices.plugins.entry_points", search)
    os.utime(tmp_path, (0, 0))
    first, again = kind.lookup.names(), kind.lookup.names()
    late = tmp_path / "b_maker-1.0.dist-info"
    late.mkdir()
    (late / "entry_points.txt").write_text(f"[{kind.lookup.GROUP}]\nlate = m:PLUGIN\n")
    (late / "METADATA").write_text("Name: b-maker\nVersion: 1.0\n")
    os.utime(tmp_path)  # the clock of a file system may be too coarse to see the change

    assert "early" in first
    assert "late" not in first
    assert first == again
    assert set(kind.lookup.names()) == {*first, "late"}
    assert searches == [kind.lookup.GROUP] * 2


def test_plugin_of_another_distribution_is_loaded(kind: Kind, install: Install) -> None:
    """Any installed distribution can provide a plug-in."""
    install("a-maker", "stage", "good", f"NAME = 'stage'{kind.good}")

    assert kind.lookup.load("stage").summary == "for tests"


def test_unknown_name_lists_the_known_ones(kind: Kind) -> None:
    """The message for a misspelt name lists the known names."""
    with pytest.raises(
        RegistryError,
        match=rf"unknown {kind.called} 'simulatde', known {kind.called}s: .*{kind.known}",
    ):
        kind.lookup.load("simulatde")


def test_unknown_name_when_nothing_is_installed(
    kind: Kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The message states that none is installed."""
    monkeypatch.setattr(kind.lookup, "GROUP", "a.group.that.nobody.uses")

    with pytest.raises(RegistryError, match=f"known {kind.called}s: none is installed"):
        kind.lookup.load(kind.known)


def test_duplicate_name_is_refused(kind: Kind, install: Install) -> None:
    """If two plug-ins have the same name, neither is chosen."""
    install("b-maker", "stage", "b", f"NAME = 'stage'{kind.good}")
    install("a-maker", "stage", "a", f"NAME = 'stage'{kind.good}")

    with pytest.raises(
        RegistryError, match=r"'stage' is provided by a-maker 1\.0 and b-maker 1\.0"
    ):
        kind.lookup.load("stage")
    assert kind.lookup.names().count("stage") == 1


@pytest.mark.parametrize("source", ["raise OSError('no such bus')", "import no_such_module", ""])
def test_plugin_that_cannot_be_imported_names_its_distribution(
    kind: Kind, install: Install, source: str
) -> None:
    """For any error during the import, the message names the distribution."""
    install("a-maker", "stage", f"stage_{len(source)}", source)

    with pytest.raises(RegistryError, match=r"of a-maker 1\.0\) cannot be imported: "):
        kind.lookup.load("stage")


def test_plugin_of_another_type_is_refused(kind: Kind, install: Install) -> None:
    """The entry point must refer to a plug-in of its kind."""
    install("a-maker", "stage", "text", "PLUGIN = 'a text'")

    with pytest.raises(RegistryError, match=f"is of type str, not {kind.type_name}"):
        kind.lookup.load("stage")


def test_plugin_of_another_name_is_refused(kind: Kind, install: Install) -> None:
    """The plug-in must have the name of its entry point."""
    install("a-maker", "stage", "by_alias", f"NAME = 'alias'{kind.good}")

    with pytest.raises(RegistryError, match="calls itself 'alias': the two names must agree"):
        kind.lookup.load("stage")
