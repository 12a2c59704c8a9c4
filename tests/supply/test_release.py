"""What `make release` refuses."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.supply.release import ROOT, missing, refusals, version_of

IDENTITY = {
    f"GIT_{who}_{what}": "piezod@example.org"
    for who in ("AUTHOR", "COMMITTER")
    for what in ("NAME", "EMAIL")
}


def git(folder: Path, *arguments: str) -> None:
    """Run git in a folder, without the settings of the person who runs the tests."""
    alone = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_SYSTEM": os.devnull}
    environ = {name: text for name, text in os.environ.items() if not name.startswith("GIT_")}
    command = ("git", "-C", str(folder), *arguments)
    subprocess.run(command, env=environ | alone | IDENTITY, check=True)


def checkout(folder: Path, heading: str) -> Path:
    """Return a clean checkout of version 1.2.3 whose notes begin with a heading."""
    (folder / "pyproject.toml").write_text('[project]\nversion = "1.2.3"\n', encoding="utf-8")
    (folder / "CHANGELOG.md").write_text(f"# Changelog\n\n{heading}\n\nNotes.\n", encoding="utf-8")
    git(folder, "init", "--quiet")
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "--message", "All")
    return folder


def test_a_clean_checkout_with_notes_is_released(tmp_path: Path) -> None:
    """Nothing speaks against it."""
    assert list(refusals(checkout(tmp_path, "## [1.2.3] - 2026-11-28"))) == []


@pytest.mark.parametrize(
    ("heading", "reason"),
    [
        ("## [1.2.2] - 2026-11-28", "notes of [1.2.2]"),
        ("## [Unreleased]", "notes of [Unreleased]"),
        ("Nothing yet.", "notes of [none]"),
        ("## [1.2.3]", "have no day"),
    ],
)
def test_a_version_without_notes_is_refused(tmp_path: Path, heading: str, reason: str) -> None:
    """The newest notes are those of the version, and have a day."""
    (found,) = refusals(checkout(tmp_path, heading))

    assert reason in found


def test_a_tree_with_changes_is_refused(tmp_path: Path) -> None:
    """A file that no commit has would be in the sdist, or be missing there: it is named."""
    folder = checkout(tmp_path, "## [1.2.3] - 2026-11-28")
    (folder / "forgotten.py").write_text("", encoding="utf-8")
    (found,) = refusals(folder)

    assert "forgotten.py" in found


def test_a_version_that_was_released_is_refused(tmp_path: Path) -> None:
    """A tag is never given to other files."""
    folder = checkout(tmp_path, "## [1.2.3] - 2026-11-28")
    git(folder, "tag", "v1.2.3")
    (found,) = refusals(folder)

    assert "v1.2.3" in found


def test_what_a_release_needs_is_missed(tmp_path: Path) -> None:
    """Files of another version do not count."""
    for name in ("piezod-1.2.3.tar.gz", "piezod-1.2.2-py3-none-any.whl"):
        (tmp_path / name).touch()

    assert missing(tmp_path, "1.2.3") == ["piezod-1.2.3-py3-none-any.whl", "piezod-1.2.3.cdx.json"]


def test_this_version_has_its_notes() -> None:
    """What stands in the project file is what the changelog begins with."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")

    assert f"\n## [{version_of(ROOT)}]" in text
