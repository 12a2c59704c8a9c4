"""Tests of the parts list of the wheel."""

from typing import Any

import pytest

from tests.supply.sbom import needs_of, parts_list

PROJECT = {
    "dependencies": ["PyYAML>=6.0", "httpcore[asyncio]>=1.0"],
    "optional-dependencies": {"can": ["python_can>=2.4"], "parquet": ["pyarrow"], "dev": ["mypy"]},
}
INSTALLED = {
    "pyyaml": None,
    "httpcore": ["h11", "anyio; extra == 'asyncio'", "h2; extra == 'http2'"],
    "h11": ["typing-extensions; python_version < '3.0'"],
    "anyio": ["h11"],
    "python-can": ["wrapt", "pytest; extra == 'test'"],
    "wrapt": [],
    "pyarrow": [],
}
NEEDS = needs_of(PROJECT, INSTALLED.__getitem__)


def document(*names: str) -> dict[str, Any]:
    """Return a parts list of an environment with these packages."""
    return {
        "metadata": {"component": {"bom-ref": "root"}},
        "components": [{"name": name, "bom-ref": f"{name}==1"} for name in names],
        "dependencies": [{"ref": "wrapt==1", "dependsOn": ["mypy==1"]}],
    }


def test_requirements_are_those_of_an_installation_with_the_extras_for_users() -> None:
    """An extra counts if somebody requires it; markers count as on this machine."""
    assert dict(NEEDS) == {
        "": {"pyyaml", "httpcore", "python-can", "pyarrow"},
        "pyyaml": set(),
        "httpcore": {"h11", "anyio"},
        "h11": set(),
        "anyio": {"h11"},
        "python-can": {"wrapt"},
        "wrapt": set(),
        "pyarrow": set(),
    }


def test_parts_list_has_what_an_installation_brings() -> None:
    """Tools for the development are left out, also where the metadata of a part mention them."""
    names = ("PyYAML", "httpcore", "h11", "anyio", "python_can", "wrapt", "pyarrow", "mypy")
    made = parts_list(document(*names), NEEDS)

    assert {each["name"] for each in made["components"]} == {*names} - {"mypy"}
    needs = {each["ref"]: each["dependsOn"] for each in made["dependencies"]}
    assert needs["root"] == ["PyYAML==1", "httpcore==1", "pyarrow==1", "python_can==1"]
    assert needs["wrapt==1"] == []


def test_parts_list_is_complete() -> None:
    """A part that is not installed is an error, not a gap."""
    with pytest.raises(ValueError, match="not installed: anyio, h11, httpcore"):
        parts_list(document("PyYAML", "python_can", "wrapt", "pyarrow"), NEEDS)
