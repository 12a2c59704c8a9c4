"""The lock files are whole, and the oldest versions that `pyproject.toml` allows are tested."""

from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from tests.supply.lock import LOCK, TOOLS, named, pinned, project

PLACES = [
    {"python_version": version, "python_full_version": f"{version}.1", "platform_machine": machine}
    for version in ("3.11", "3.12", "3.13")
    for machine in ("x86_64", "aarch64")
]
"""Where piezod runs; all else of a marker is as here."""


def version_of(pin: Requirement) -> Version:
    """Return the version that a lock file pins."""
    (specifier,) = pin.specifier
    return Version(specifier.version)


def required(text: str, extras: set[str], place: dict[str, str]) -> Requirement | None:
    """Return a requirement if it counts with these extras in a place."""
    requirement = Requirement(text)
    marker = requirement.marker
    if marker is None or any(marker.evaluate(place | {"extra": each}) for each in extras | {""}):
        return requirement
    return None


def requires(name: str, version: Version) -> list[str]:
    """Return what a version of a package requires; nothing if it is not the one installed here."""
    try:
        found = metadata.distribution(name)
    except metadata.PackageNotFoundError:  # needed elsewhere only
        return []
    return (found.requires or []) if Version(found.version) == version else []


def missing(place: dict[str, str]) -> Iterator[str]:
    """Yield what packages of `requirements.lock` require in a place and it does not pin there."""
    versions = {
        canonicalize_name(pin.name): version_of(pin)
        for pin in pinned(LOCK)
        if pin.marker is None or pin.marker.evaluate(place)
    }
    waiting = [*named(["can", "parquet", "dev"])]
    seen = set()
    while waiting:
        requirement = waiting.pop()
        if str(requirement) in seen:
            continue
        seen.add(str(requirement))
        name = canonicalize_name(requirement.name)
        if name not in versions or not requirement.specifier.contains(versions[name]):
            yield str(requirement)
            continue
        texts = requires(name, versions[name])
        found = (required(text, requirement.extras, place) for text in texts)
        waiting += [each for each in found if each is not None]


@pytest.mark.parametrize("place", PLACES, ids=lambda each: " ".join(each.values()))
def test_lock_is_whole(place: dict[str, str]) -> None:
    """Nothing has to be resolved at set-up, on no Python and processor that piezod runs on."""
    assert list(missing(place)) == []


@pytest.mark.parametrize("lock", [LOCK, *sorted(TOOLS.glob("*.txt"))], ids=lambda each: each.stem)
def test_every_pin_has_a_hash(lock: Path) -> None:
    """A set-up takes no file that was not there when the lock was made."""
    blocks = lock.read_text().replace("\\\n", "").splitlines()
    lines = [each for each in blocks if each and not each.lstrip().startswith("#")]

    assert [line for line in lines if "==" not in line or "--hash=sha256:" not in line] == []


@pytest.mark.parametrize(
    ("lock", "extras"),
    [
        ("lowest", ["can", "figures", "parquet", "dev"]),
        ("bluesky", ["bluesky"]),
        ("epics", ["epics"]),
    ],
)
def test_lower_bounds_are_tested(lock: str, extras: list[str]) -> None:
    """Each lower bound of `pyproject.toml` is the version with which its tests run."""
    lock_file = TOOLS / f"{lock}.txt"
    tested = {canonicalize_name(pin.name): version_of(pin) for pin in pinned(lock_file)}
    everybodys = {each.name for each in named([])} if lock != "lowest" else set()
    for requirement in named(extras):
        if requirement.name in everybodys:
            continue
        (bound,) = [each.version for each in requirement.specifier if each.operator == ">="]
        assert (requirement.name, tested[canonicalize_name(requirement.name)]) == (
            requirement.name,
            Version(bound),
        )


def test_every_extra_is_tested() -> None:
    """No extra has bounds that nothing tests."""
    extras = project()["optional-dependencies"]
    with_all = next(each for each in extras["dev"] if each.startswith("piezod["))
    tested = set(with_all.removeprefix("piezod[").removesuffix("]").split(","))
    assert set(extras) == tested | {"dev", "bluesky", "epics"}
