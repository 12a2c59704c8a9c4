"""The copy of an accepted configuration."""

import errno
import json
import os
from pathlib import Path

import pytest

from piezod.daemon import accepted_config
from piezod.daemon.loop import accept
from piezod.errors import ConfigError
from tests.config.test_response_file import TEXT as RESPONSE
from tests.daemon.daemons import REPOSITORY

SHIPPED = REPOSITORY / "config" / "simulated.yaml"


def test_copy_has_the_same_values(tmp_path: Path) -> None:
    """The copy has the values of the file."""
    config = accept.load(SHIPPED)

    copy = accepted_config.keep(config, tmp_path / "kept", "simulated")

    assert copy.name == "simulated.yaml"
    expected = accepted_config.document(config)
    found = accepted_config.document(accept.load(copy))
    model = Path(found["axes"]["x"].pop("model"))
    assert model.read_bytes() == Path(expected["axes"]["x"].pop("model")).read_bytes()
    assert found == expected


def test_copy_holds_the_response(tmp_path: Path) -> None:
    """The copy does not need the response file, and gives the same first mode."""
    response, stage = tmp_path / "r.yaml", tmp_path / "stage.yaml"
    response.write_text(RESPONSE, encoding="utf-8")
    text = SHIPPED.read_text(encoding="utf-8").replace("models/", f"{SHIPPED.parent}/models/")
    mode = "first_mode: {frequency_hz: 734, damping: 0.03}"
    assert mode in text
    stage.write_text(text.replace(mode, f"response: {response}"), encoding="utf-8")
    config = accept.load(stage)

    copy = accepted_config.keep(config, tmp_path / "kept", "stage")
    response.unlink()

    kept, given = accept.load(copy).axes["x"], config.axes["x"]
    assert given.response is not None
    assert given.first_mode is not None
    assert (kept.response, kept.first_mode) == (given.response, given.first_mode)


def test_a_supervisor_reads_the_same_without_drivers() -> None:
    """Without drivers, options of devices stay as they are in the file."""
    document = accepted_config.document(accept.load(SHIPPED))

    config = accepted_config.parsed(json.dumps(document), SHIPPED)

    assert accepted_config.document(config) == document


def test_copy_replaces_the_older_one(tmp_path: Path) -> None:
    """No file of an older configuration stays in the folder."""
    folder = tmp_path / "kept"
    folder.mkdir()
    (folder / "old.yaml").touch()

    accepted_config.keep(accept.load(SHIPPED), folder, "simulated")

    assert sorted(path.name for path in folder.iterdir()) == ["model-x.yaml", "simulated.yaml"]


def test_paths_are_absolute() -> None:
    """The copy is in another folder than the file."""
    document = accepted_config.document(accept.load(SHIPPED))

    assert Path(document["axes"]["x"]["model"]).is_absolute()


def test_command_line_may_ask_for_real_time(tmp_path: Path) -> None:
    """`--strict-rt` reaches the loop through the copy."""
    config = accept.load(SHIPPED, strict_rt=True)

    copy = accepted_config.keep(config, tmp_path / "kept", "simulated")

    assert accept.load(copy).loop.strict_rt


@pytest.mark.fault("P10")
def test_unsafe_gain_is_a_mistake_of_the_configuration(tmp_path: Path) -> None:
    """A problem that only the mathematics finds is reported like one of the schema."""
    text = SHIPPED.read_text(encoding="utf-8")
    text = text.replace("gain_per_s: 50", "gain_per_s: 5000")
    text += "mode: trimmed\n"
    path = SHIPPED.with_name("simulated.yaml")
    unsafe = tmp_path / "unsafe.yaml"
    unsafe.write_text(text.replace("models/", f"{path.parent}/models/"), encoding="utf-8")

    with pytest.raises(ConfigError, match=r"unsafe\.yaml"):
        accept.load(unsafe)


@pytest.mark.fault("P6")
def test_copy_that_cannot_be_written_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The supervisor gets number, text and file of the error."""

    def full(_path: Path, _content: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    monkeypatch.setattr(os, "dup2", lambda *_: None)
    copy = tmp_path / "kept" / "simulated.yaml"

    assert accept.accept(SHIPPED, copy, strict_rt=False) is None
    model = str(copy.parent / "model-x.yaml")
    failed = {"failed": [errno.ENOSPC, "No space left on device", model]}
    assert json.loads(capfd.readouterr().out) == failed
