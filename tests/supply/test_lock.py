"""`requirements.lock` can be installed by every pip, also after newer releases of what it pins."""

import re
from collections.abc import Iterator
from importlib import metadata

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.supply.audit import LOCK

PINNED = re.compile(r"^([A-Za-z0-9._-]+)(?:\[([^]]+)\])?==", re.MULTILINE)


def requirements() -> Iterator[Requirement]:
    """Yield what the installed packages require here."""
    for package in metadata.distributions():
        for text in package.requires or ():
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                yield requirement


def test_lock_names_the_extras_that_packages_require() -> None:
    """Pip 23 takes the newest release for a package with extras that the lock pins without them."""
    pinned = {
        canonicalize_name(name): set(extras.split(","))
        for name, extras in PINNED.findall(LOCK.read_text())
    }
    required = {
        (name, extra)
        for each in requirements()
        for extra in each.extras
        if (name := canonicalize_name(each.name)) in pinned
    }

    assert ("coverage", "toml") in required
    assert [each for each in sorted(required) if each[1] not in pinned[each[0]]] == []
