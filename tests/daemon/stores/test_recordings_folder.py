"""Names of recordings: made by the daemon, never leading out of their folder."""

from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.daemon.stores.recordings_folder import RecordingsFolder

WHEN = datetime(2024, 5, 1, 12, 30, 15, tzinfo=UTC)


@pytest.fixture
def folder(tmp_path: Path) -> RecordingsFolder:
    """Return an empty folder."""
    return RecordingsFolder(tmp_path / "recordings")


def test_names_tell_the_time_in_utc(folder: RecordingsFolder) -> None:
    """A name is the time of day in UTC, followed by the label."""
    east = WHEN.astimezone(timezone(timedelta(hours=2)))

    assert folder.new(WHEN).name == "20240501T123015Z.h5"
    assert folder.new(east, "before-lunch").name == "20240501T123015Z-before-lunch.h5"


def test_names_are_never_given_twice(folder: RecordingsFolder) -> None:
    """Recordings of the same second are numbered."""
    names = []
    for _ in range(3):
        path = folder.new(WHEN, "a")
        path.touch()
        names.append(path.stem)

    assert names == ["20240501T123015Z-a", "20240501T123015Z-2-a", "20240501T123015Z-3-a"]
    assert sorted(each.name for each in folder.files()) == sorted(names)


@pytest.mark.parametrize("label", ["..", "a/b", "a b", "-a", "a" * 33, "ä", "a\n", ".h5"])
def test_labels_that_could_lead_elsewhere_are_refused(folder: RecordingsFolder, label: str) -> None:
    """A label has at most 32 letters, digits, _ and -."""
    with pytest.raises(ValueError, match="allowed are up to 32"):
        folder.new(WHEN, label)


@pytest.mark.fault("C7")
@pytest.mark.parametrize(
    "name",
    ["../20240501T123015Z", "..", "", "20240501T123015Z/../x", "20240501T123015Z\0", "x", "%2e%2e"],
)
def test_names_that_lead_elsewhere_find_nothing(folder: RecordingsFolder, name: str) -> None:
    """No name finds a file outside the folder."""
    (folder.path.parent / "20240501T123015Z.h5").touch()
    (folder.path.parent / "x.h5").touch()

    assert folder.find(name) is None


@pytest.mark.fault("C7")
def test_links_are_not_followed(folder: RecordingsFolder, tmp_path: Path) -> None:
    """A link with a valid name is neither found nor listed."""
    (tmp_path / "secret").touch()
    (folder.path / "20240501T123015Z.h5").symlink_to(tmp_path / "secret")

    assert folder.find("20240501T123015Z") is None
    assert folder.files() == ()


@pytest.mark.fault("C7")
@given(name=st.text() | st.from_regex(r"[0-9]{8}T[0-9]{6}Z[./a-z-]*", fullmatch=True))
def test_found_files_are_in_the_folder(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Any text finds a file in the folder, or none."""
    folder = RecordingsFolder(tmp_path_factory.getbasetemp() / "recordings")
    found = folder.find(name)

    assert found is None or found.parent == folder.path


def test_newest_are_kept(folder: RecordingsFolder) -> None:
    """Older recordings are removed; other files stay."""
    for second in range(5):
        folder.new(WHEN + timedelta(seconds=second)).write_bytes(b"12")
    (folder.path / "notes.txt").touch()
    folder.keep_newest(2)

    assert [each.name for each in folder.files()] == ["20240501T123019Z", "20240501T123018Z"]
    assert folder.files()[0].size_bytes == 2
    assert (folder.path / "notes.txt").exists()
