"""The list of evidence is that of the marks of the tests."""

from tests.evidence import KINDS, PAGE, WORDS, marks, page, profiles, words


def test_page_and_words_are_those_of_the_marks() -> None:
    """`python -m tests.evidence` was run after the last change of a mark or a profile."""
    found = marks()

    assert PAGE.read_text(encoding="utf-8") == page(found)
    assert WORDS.read_text(encoding="utf-8") == words(found)


def test_every_mark_names_a_profile_and_a_kind() -> None:
    """No mark has a mistyped driver, profile or kind, or an empty text."""
    known = {(driver, profile) for driver, names in profiles().items() for profile in names}
    found = marks()

    assert [each for each in found if (each.driver, each.profile) not in known] == []
    assert [each for each in found if each.kind not in KINDS] == []
    assert [each for each in found if not (each.part and each.by)] == []
    assert len(set(found)) == len(found)


def test_every_driver_of_a_device_has_profiles() -> None:
    """Each driver has at least one profile, so that its evidence is listed."""
    assert all(profiles().values())
