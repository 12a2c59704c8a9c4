"""Whether the configuration file and the files that it names are still those in force."""

import hashlib
import os
from pathlib import Path

import pytest

from piezod.daemon.loop import accept
from piezod.daemon.supervisor.source_files import SourceFiles
from tests.config.test_response_file import TEXT as RESPONSE
from tests.daemon.daemons import SHIPPED, configuration


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return a configuration file."""
    path = tmp_path / "stage.yaml"
    path.write_text("rate_hz: 100", encoding="utf-8")
    return path


@pytest.mark.fault("P11")
def test_other_contents_are_a_change_until_they_are_taken_back(path: Path) -> None:
    """The same length does not hide it."""
    file = SourceFiles(path)
    before = file.changed()
    path.write_text("rate_hz: 200", encoding="utf-8")
    os.utime(path, ns=(1, 1))
    edited = [file.changed(), file.changed()]
    path.write_text("rate_hz: 100", encoding="utf-8")

    assert (before, edited, file.changed()) == (False, [True, True], False)


@pytest.mark.fault("P11")
def test_touched_file_is_no_change(path: Path) -> None:
    """Only the contents count."""
    file = SourceFiles(path)
    os.utime(path, ns=(1, 1))

    assert not file.changed()


@pytest.mark.fault("P11")
def test_file_that_is_gone_or_no_file_is_a_change(path: Path) -> None:
    """A pipe is not opened: it would wait for a writer."""
    file = SourceFiles(path)
    path.unlink()
    gone = file.changed()
    os.mkfifo(path)

    assert (gone, file.changed()) == (True, True)


def named_by(config: Path) -> SourceFiles:
    """Return the files of a configuration that was read just now."""
    files, named = SourceFiles(config), dict[str, str]()
    accept.load(config, named_files=named)
    files.add(named)
    return files


@pytest.mark.fault("P11")
@pytest.mark.parametrize("kind", ["model", "response"])
def test_other_contents_of_a_named_file_are_a_change_until_they_are_taken_back(
    tmp_path: Path, kind: str
) -> None:
    """Model and response files count, wherever they are."""
    config, named = configuration(tmp_path), tmp_path / "named.yaml"
    text = config.read_text("utf-8")
    if kind == "model":
        model = SHIPPED.parent / "models" / "simulated-stack.yaml"
        named.write_bytes(model.read_bytes())
        text = text.replace(str(model), "named.yaml")
    else:
        named.write_text(RESPONSE, encoding="utf-8")
        text = text.replace(
            "first_mode: {frequency_hz: 734, damping: 0.03}", "response: named.yaml"
        )
    assert "named.yaml" in text
    config.write_text(text, encoding="utf-8")
    files, before = named_by(config), named.read_text("utf-8")
    unchanged = files.changed()
    named.write_text(before + "# edited\n", encoding="utf-8")
    edited = [files.changed(), files.changed(), named_by(config).changed()]
    named.write_text(before, encoding="utf-8")

    assert (unchanged, edited, files.changed()) == (False, [True, True, False], False)


@pytest.mark.fault("P11")
def test_file_that_is_edited_after_it_was_read_is_a_change(path: Path, tmp_path: Path) -> None:
    """Its contents before they were read count, not those when it is looked at first."""
    named = tmp_path / "model.yaml"
    named.write_text("later", encoding="utf-8")
    files = SourceFiles(path)
    files.add({str(named): hashlib.sha256(b"earlier").hexdigest()})

    assert files.changed()
