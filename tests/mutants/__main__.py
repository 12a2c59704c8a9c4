"""Changes the modules that stop a stage in one place at a time: each change must fail a test.

`make mutants` runs it for all modules, `make mutants MODULES=guard` for one. Changes that alter
nothing that anybody can see are listed in `equivalent.yaml`, each with the reason. It fails if a
change survives that is not listed, and if a listed one does not survive any more.
"""

import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import yaml

from tests.mutants.modules import MODULES
from tests.mutants.workshop import Change, Findings, findings

LIST: Final = Path(__file__).with_name("equivalent.yaml")


def listed(name: str) -> Counter[Change]:
    """Return the mutants of a module that are equivalent to it."""
    entries = yaml.safe_load(LIST.read_text(encoding="utf-8"))[name] or []
    assert all(entry["why"] for entry in entries)
    return Counter(Change(*(entry[field].strip() for field in Change._fields)) for entry in entries)


def complaints(found: Findings, equivalent: Counter[Change]) -> list[str]:
    """Return what is wrong: survivors that are not listed, and listed ones that are gone."""
    survivors = Counter(found.survivors)
    return [
        *(f"no test notices the change {each}" for each in (survivors - equivalent).elements()),
        *(f"{LIST.name} has a change that {gone}" for gone in _gone(equivalent - survivors)),
    ]


def _gone(changes: Counter[Change]) -> list[str]:
    return [f"a test notices, or that is no longer made, {each}" for each in changes.elements()]


def main(names: Sequence[str]) -> int:
    """Test the mutants of the named modules, or of all; return the exit code."""
    wrong = 0
    for name in names or MODULES:
        start_s = time.monotonic()
        found = findings(name, MODULES[name])
        problems = complaints(found, listed(name))
        survived, taken_s = len(found.survivors), time.monotonic() - start_s
        print(f"{name}: {found.total} changes, {survived} not noticed, {taken_s:.0f} s", flush=True)
        for problem in problems:
            print(problem, flush=True)
        wrong += len(problems)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
