"""`piezod drivers`."""

import json
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest

import piezod as package
from piezod.devices.evidence import evidence_of
from piezod.errors import RegistryError
from tests.cli.conftest import Command
from tests.evidence import WORDS


def test_list_for_people(piezod: Command) -> None:
    """The simulated rig is installed and not confirmed on hardware."""
    code, out, err = piezod("drivers")

    assert (code, err) == (0, "")
    (line,) = [line for line in out.splitlines() if line.split()[:1] == ["simulated"]]
    assert " no " in line
    assert "piezod" in line


def test_list_for_programs(piezod: Command) -> None:
    """The document has a row for each driver."""
    code, out, err = piezod("drivers", "--json")

    assert (code, err) == (0, "")
    rows = {row["name"]: row for row in json.loads(out)["drivers"]}
    assert rows["simulated"] == {
        "name": "simulated",
        "distribution": f"piezod {package.__version__}",
        "summary": "a simulated stage with amplifier and sensor",
        "confirmed_on_hardware": False,
        "sees": [],
        "evidence": {},
        "error": None,
    }


def test_broken_driver_is_listed_with_the_reason(
    piezod: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A driver that cannot be imported is listed with the reason, beside the others."""

    def fail(name: str) -> None:
        raise RegistryError(f"driver {name!r} cannot be imported: no module named 'acme'")

    monkeypatch.setattr("piezod.devices.registry.load", fail)

    code, out, _ = piezod("drivers", "--json")
    row = next(row for row in json.loads(out)["drivers"] if row["name"] == "simulated")
    assert (code, row["confirmed_on_hardware"], row["summary"]) == (0, None, None)
    assert row["error"] == "driver 'simulated' cannot be imported: no module named 'acme'"

    code, out, _ = piezod("drivers")
    assert code == 0
    assert "cannot be imported" in out


def test_no_driver(piezod: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty list is reported in words."""
    monkeypatch.setattr("piezod.devices.registry.names", lambda: ())

    assert piezod("drivers") == (0, "No driver is installed.\n", "")
    assert json.loads(piezod("drivers", "--json").out) == {"drivers": []}


def test_document_lists_the_faults_that_a_driver_sees(piezod: Command) -> None:
    """The document lists faults in the order of their numbers."""
    (row,) = (
        row
        for row in json.loads(piezod("drivers", "--json").out)["drivers"]
        if row["name"] == "psj"
    )

    assert {"B1", "B5"} <= set(row["sees"])
    assert row["sees"].index("B5") < row["sees"].index("B14")


def test_each_profile_has_the_word_of_its_evidence(piezod: Command) -> None:
    """Both forms of the list show what each profile was checked against."""
    expected = json.loads(WORDS.read_text(encoding="utf-8"))
    rows = json.loads(piezod("drivers", "--json").out)["drivers"]
    lines = [line.split() for line in piezod("drivers").out.splitlines()]

    assert {row["name"]: row["evidence"] for row in rows if row["evidence"]} == expected
    for driver, words in expected.items():
        for profile, word in words.items():
            assert [driver, profile, *word.split()] in lines


def test_driver_without_a_statement_has_no_evidence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A driver that is one module, is gone, does not state it, or has a broken file, has none."""
    package = tmp_path / "acme_broken"
    package.mkdir()
    for name, text in (("__init__.py", ""), ("evidence.json", "{broken")):
        (package / name).write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    for module in ("json.tool", "string", "no_such_module", "piezod.errors", "acme_broken.driver"):
        point = EntryPoint("acme", f"{module}:PLUGIN", "piezod.drivers")
        points = EntryPoints([point])
        monkeypatch.setattr("piezod.devices.evidence.points_of", lambda _, found=points: found)
        assert evidence_of("acme") == {}
