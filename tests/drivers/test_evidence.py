"""The list of evidence is that of the marks of the tests."""

import pytest

from tests.evidence import (
    KINDS,
    NONE,
    WORDS,
    Evidence,
    marks,
    profiles,
    word_of,
    words,
)


@pytest.fixture(scope="module")
def found() -> list[Evidence]:
    """Return the marks of all tests, read once."""
    return marks()


def test_words_are_those_of_the_marks(found: list[Evidence]) -> None:
    """`python -m tests.evidence` was run after the last change of a mark or a profile."""
    assert WORDS.read_text(encoding="utf-8") == words(found)


def test_every_mark_names_a_profile_and_a_kind(found: list[Evidence]) -> None:
    """No mark has a mistyped driver, profile or kind, or an empty text."""
    known = {(driver, profile) for driver, names in profiles().items() for profile in names}

    assert [each for each in found if (each.driver, each.profile) not in known] == []
    assert [each for each in found if each.kind not in KINDS] == []
    assert [each for each in found if not (each.part and each.by)] == []
    assert len(set(found)) == len(found)


def test_every_driver_of_a_device_has_profiles() -> None:
    """Each driver has at least one profile, so that its evidence is listed."""
    assert all(profiles().values())


def test_every_device_has_evidence(found: list[Evidence]) -> None:
    """Each profile was checked against something by others."""
    missing = [
        (driver, profile)
        for driver, names in profiles().items()
        for profile in names
        if word_of(found, driver, profile) == NONE
    ]

    assert missing == []
