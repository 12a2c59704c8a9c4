"""Names of what replaces nothing."""

from pathlib import Path

import pytest

from piezod.records.new_name import new_file, new_folder


def test_free_name_is_taken_as_it_is(tmp_path: Path) -> None:
    """The parents are made."""
    with new_folder(tmp_path / "a" / "b.c") as folder, new_file(folder / "d.e.csv") as file:
        file.write_text("1", encoding="utf-8")

    assert file == tmp_path / "a" / "b.c" / "d.e.csv"
    assert file.is_file()


@pytest.mark.parametrize("taken", ["folder", "file", "link", "dangling link"])
def test_taken_name_gets_a_number(tmp_path: Path, taken: str) -> None:
    """Whatever has the name stays as it was, and a link is not followed."""
    name, aside = tmp_path / "name.csv", tmp_path / "aside"
    match taken:
        case "folder":
            name.mkdir()
        case "file":
            name.write_text("old", encoding="utf-8")
        case "link":
            aside.mkdir()
            name.symlink_to(aside)
        case _:
            name.symlink_to(aside)
    with new_folder(name) as folder, new_file(name) as file:
        (folder / "record").write_text("new", encoding="utf-8")
        file.write_text("new", encoding="utf-8")

    assert (folder.name, file.name) == ("name.csv-2", "name-2.csv")
    assert name.is_symlink() == ("link" in taken)
    assert not name.is_file() or name.read_text(encoding="utf-8") == "old"
    assert not aside.exists() or not list(aside.iterdir())


def test_nothing_is_left_without_results(tmp_path: Path) -> None:
    """An error leaves neither an empty folder nor an empty file."""

    class FailedError(Exception):
        pass

    with pytest.raises(FailedError), new_folder(tmp_path / "a"), new_file(tmp_path / "b"):
        raise FailedError

    assert list(tmp_path.iterdir()) == []


def test_present_folder_is_no_new_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder beside it is made for `.`."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with new_folder(Path()) as folder:
        assert folder == tmp_path.resolve() / "here-2"
