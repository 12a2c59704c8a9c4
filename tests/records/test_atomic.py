from pathlib import Path

import pytest

from piezod.records.atomic import replacing


def test_file_appears_when_the_block_ends(tmp_path: Path) -> None:
    """Within the block the file does not exist; after it, the file is complete and alone."""
    path = tmp_path / "new folder" / "file.txt"

    with replacing(path) as temporary:
        temporary.write_text("whole", encoding="utf-8")
        assert not path.exists()
        assert temporary.parent == path.parent

    assert [each.name for each in path.parent.iterdir()] == ["file.txt"]
    assert path.read_text(encoding="utf-8") == "whole"


def test_older_file_survives_a_failure(tmp_path: Path) -> None:
    """A failure within the block leaves the older file unchanged and no other file."""
    path = tmp_path / "file.txt"
    path.write_text("old", encoding="utf-8")

    with pytest.raises(RuntimeError), replacing(path) as temporary:
        temporary.write_text("half", encoding="utf-8")
        raise RuntimeError

    assert [each.name for each in tmp_path.iterdir()] == ["file.txt"]
    assert path.read_text(encoding="utf-8") == "old"


def test_failure_names_the_file_that_was_asked_for(tmp_path: Path) -> None:
    """The error contains the name of the file, not the temporary one."""
    path = tmp_path / "file.txt"

    with pytest.raises(IsADirectoryError) as caught, replacing(path) as temporary:
        temporary.mkdir()
        try:
            temporary.write_text("", encoding="utf-8")
        finally:
            temporary.rmdir()

    assert caught.value.filename == str(path)
