"""The parts list of the wheel, in the format CycloneDX: what an installation brings, no more.

`make wheel` writes it beside the wheel. cyclonedx-py describes all packages of .venv, and takes the
extras of each for requirements; here those parts are kept that `pip install piezod` would bring on
this machine, with the extras for users.
"""

import json
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import requires
from pathlib import Path
from typing import Any, Final

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT: Final = Path(__file__).parents[2]
TOOL: Final = ROOT / "build" / "audit" / "bin" / "cyclonedx-py"
PROJECT: Final = ROOT / "pyproject.toml"
USERS_EXTRAS: Final = ("can", "parquet")

Requires = Callable[[str], Iterable[str] | None]
Needs = Mapping[str, frozenset[str]]
"""For each package the names of those that it requires; "" is the wheel."""


def needs_of(project: Mapping[str, Any], requires_of: Requires = requires) -> Needs:
    """Return what the wheel requires, and what that requires in turn.

    Args:
        project: The table `project` of pyproject.toml.
        requires_of: Returns the requirements of an installed package, as its metadata has them.
    """
    extras = (project["optional-dependencies"][extra] for extra in USERS_EXTRAS)
    lines = [line for group in (project["dependencies"], *extras) for line in group]
    needs: dict[str, set[str]] = {"": set()}
    fresh = [("", Requirement(line)) for line in lines]
    seen = set()
    while fresh:
        parent, wanted = fresh.pop()
        name = canonicalize_name(wanted.name)
        needs[parent].add(name)
        needs.setdefault(name, set())
        for extra in {"", *wanted.extras}:
            if (name, extra) not in seen:
                seen.add((name, extra))
                found = map(Requirement, requires_of(name) or ())
                fresh += [(name, each) for each in found if _applies(each, extra)]
    return {name: frozenset(names) for name, names in needs.items()}


def _applies(requirement: Requirement, extra: str) -> bool:
    """Return whether a requirement holds here, for an extra of the package that has it."""
    marker = requirement.marker
    return marker.evaluate({"extra": extra}) if marker else not extra


def parts_list(document: Mapping[str, Any], needs: Needs) -> dict[str, Any]:
    """Return the document with the needed parts, and with what they really require."""
    kept = {canonicalize_name(each["name"]): each for each in document["components"]}
    kept = {name: each for name, each in sorted(kept.items()) if name in needs}
    if missing := needs.keys() - kept.keys() - {""}:
        raise ValueError(f"not installed: {', '.join(sorted(missing))}")
    refs = {"": document["metadata"]["component"]["bom-ref"]}
    refs |= {name: each["bom-ref"] for name, each in kept.items()}
    edges = [
        {"ref": ref, "dependsOn": sorted(refs[needed] for needed in needs[name])}
        for name, ref in refs.items()
    ]
    return {**document, "components": list(kept.values()), "dependencies": edges}


def main(folder: Path) -> None:
    """Write the parts list into a folder."""
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    options = ("--pyproject", PROJECT, "--mc-type", "application", "--output-reproducible")
    command = (TOOL, "environment", *options, ROOT / ".venv" / "bin" / "python")
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    document = parts_list(json.loads(done.stdout), needs_of(project))
    path = folder / f"{project['name']}-{project['version']}.cdx.json"
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    print(f"piezod: {path}, {len(document['components'])} packages")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
