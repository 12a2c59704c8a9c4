"""The parameter store: saved parameters come back exactly, or are refused."""

import errno
import os
from math import inf, nan
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.daemon.stores.parameter_document import (
    OFFSET_LIMIT,
    SCALE_LIMIT,
    AxisParameters,
    ParameterDocument,
    decode,
    encode,
)
from piezod.daemon.stores.parameter_store import KEPT, Loaded, ParameterStore
from piezod.errors import DataError
from piezod.hysteresis import learner
from tests.daemon.stored import MODEL, WHEN, parameters

CONTENT = encode(
    ParameterDocument(
        sequence=7,
        stage="rig 1",
        saved_at=WHEN.isoformat(),
        saved_by="ann",
        axes=parameters(1.5),
    )
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return the folder of a store, which does not exist yet."""
    return tmp_path / "state" / "parameters"


def open_store(folder: Path, stage: str = "rig 1") -> ParameterStore:
    """Return a store with a fixed time of day."""
    return ParameterStore(folder, stage, lambda: WHEN)


def zero_of(loaded: Loaded) -> float:
    """Return the sensor zero of a loaded document, by which tests recognise it."""
    assert loaded.document is not None
    return loaded.document.axes["x"].zero_um


def why_refused(content: bytes) -> str:
    """Return the reason for which contents are refused."""
    with pytest.raises(DataError) as caught:
        decode(content)
    return str(caught.value)


def test_saved_parameters_come_back(folder: Path) -> None:
    """They are equal to the last bit, with the instant and the user of the save."""
    sequence = open_store(folder).save(parameters(1 / 3), "ann (uid 1000)")
    loaded = open_store(folder).load()

    assert sequence == 1
    assert loaded.document is not None
    assert loaded.document.axes == parameters(1 / 3)
    assert loaded.document.saved_at == "2024-05-01T12:00:00+00:00"
    assert loaded.document.saved_by == "ann (uid 1000)"
    assert loaded[1:] == ("newest", ())


def test_empty_store_gives_nothing(folder: Path) -> None:
    """Before the first save there are no parameters, and nothing is rejected."""
    assert open_store(folder).load() == Loaded(None, "", ())


def test_older_parameters_come_back_by_number(folder: Path) -> None:
    """Each save keeps the older files."""
    store = open_store(folder)
    numbers = [store.save(parameters(zero_um), "ann") for zero_um in (1.0, 2.0, 3.0)]

    assert numbers == [1, 2, 3]
    assert [zero_of(store.load(number)) for number in numbers] == [1.0, 2.0, 3.0]
    assert store.load(2).copy == "number 2"
    assert [each.sequence for each in store.history()] == [3, 2, 1]
    assert store.history()[0].axes == ("x", "y")


def test_twenty_good_files_are_kept(folder: Path) -> None:
    """Older files are removed; an invalid one does not replace a valid one."""
    store = open_store(folder)
    for zero_um in range(KEPT):
        store.save(parameters(zero_um), "ann")
    (folder / "000000020.json").write_bytes(b"")
    store.save(parameters(99.0), "ann")
    with_bad = len(store.history())
    store.save(parameters(100.0), "ann")

    assert with_bad == KEPT + 1
    assert [each.sequence for each in store.history()] == list(range(22, 1, -1))


@pytest.mark.fault("D8")
def test_no_flipped_byte_is_accepted() -> None:
    """A file with any changed byte is refused with a reason."""
    for index in range(len(CONTENT)):
        for flip in (0x01, 0x20, 0x80):
            damaged = bytearray(CONTENT)
            damaged[index] ^= flip

            assert why_refused(bytes(damaged))


@pytest.mark.fault("D8")
def test_no_truncated_file_is_accepted() -> None:
    """A file of any other length is refused with a reason."""
    for length in range(len(CONTENT)):
        assert why_refused(CONTENT[:length])
    assert why_refused(CONTENT + b"\n")


@pytest.mark.fault("D8")
@given(content=st.binary() | st.text().map(str.encode) | st.just(b"[" * 100_000))
def test_no_foreign_bytes_are_accepted(content: bytes) -> None:
    """Any other contents are refused with a reason."""
    assert why_refused(content)


@pytest.mark.fault("D8")
def test_huge_file_is_refused(folder: Path) -> None:
    """A huge file is neither parsed nor read to its end."""
    store = open_store(folder)
    with (folder / "000000001.json").open("wb") as file:
        file.truncate(1 << 40)

    assert "larger than 4194304 bytes" in store.load().rejected[0].why


@pytest.mark.fault("D8")
def test_damaged_newest_file_is_skipped_and_reported(folder: Path) -> None:
    """The file before is used, and the result has the reason for the newest one."""
    store = open_store(folder)
    store.save(parameters(1.0), "ann")
    store.save(parameters(2.0), "ann")
    newest = folder / "000000002.json"
    newest.write_bytes(newest.read_bytes()[:-3])
    loaded = store.load()

    assert zero_of(loaded) == 1.0
    assert loaded.copy == "number 1"
    assert [each.file for each in loaded.rejected] == ["000000002.json"]
    assert "cut off or damaged" in loaded.rejected[0].why
    assert "cut off or damaged" in store.history()[0].why
    assert store.save(parameters(3.0), "ann") == 3


@pytest.mark.fault("D8")
def test_requested_number_is_never_replaced_by_another(folder: Path) -> None:
    """If that file is invalid or absent, nothing is loaded; only an invalid one is rejected."""
    store = open_store(folder)
    store.save(parameters(1.0), "ann")
    store.save(parameters(2.0), "ann")
    (folder / "000000002.json").write_text("{}", encoding="utf-8")

    assert store.load(2).document is None
    assert "does not hold parameters" in store.load(2).rejected[0].why
    assert store.load(5) == Loaded(None, "", ())


@pytest.mark.fault("D8")
def test_parameters_of_another_stage_are_refused(folder: Path) -> None:
    """A folder that was copied from another stage gives no parameters, with the reason."""
    open_store(folder, "rig 1").save(parameters(1.0), "ann")
    loaded = open_store(folder, "rig 2").load()

    assert loaded.document is None
    assert "belongs to stage 'rig 1', this is 'rig 2'" in loaded.rejected[0].why


@pytest.mark.fault("D8")
def test_renamed_file_is_refused(folder: Path) -> None:
    """An old file with a new number is not taken for the newest."""
    store = open_store(folder)
    store.save(parameters(1.0), "ann")
    store.save(parameters(2.0), "ann")
    (folder / "000000001.json").rename(folder / "000000009.json")
    loaded = store.load()

    assert zero_of(loaded) == 2.0
    assert "was number 1" in loaded.rejected[0].why


@pytest.mark.fault("D8")
def test_links_and_folders_are_refused(folder: Path, tmp_path: Path) -> None:
    """Anything but a plain file is skipped with a reason."""
    store = open_store(folder)
    store.save(parameters(1.0), "ann")
    (folder / "000000001.json").rename(tmp_path / "elsewhere.json")
    (folder / "000000001.json").symlink_to(tmp_path / "elsewhere.json")
    (folder / "000000002.json").mkdir()
    loaded = store.load()

    assert loaded.document is None
    assert all("cannot be read" in each.why for each in loaded.rejected)
    assert len(loaded.rejected) == 2


def test_limits_are_those_of_the_identifiers() -> None:
    """The store cannot import them, because that would load the compiled kernels."""
    assert (OFFSET_LIMIT, SCALE_LIMIT) == (learner.OFFSET_LIMIT, learner.SCALE_LIMIT)


@pytest.mark.fault("D2")
@pytest.mark.parametrize("weight", [nan, inf, 1e7])
def test_weights_that_are_no_numbers_are_never_stored(folder: Path, weight: float) -> None:
    """Only parameters that can be loaded again are saved."""
    broken = MODEL.model_copy(update={"left_stop_weights": (weight, 0.1)})
    store = open_store(folder)
    with pytest.raises(DataError, match=r"axes\.x\.model\.left_stop_weights\.0"):
        store.save({"x": AxisParameters(model=broken, zero_um=0.0)}, "ann")

    assert store.history() == ()


@given(
    weights=st.tuples(*[st.floats(0, 0.2)] * 4),
    numbers=st.tuples(st.floats(-1e5, 1e5), st.floats(-1, 1), st.floats(-0.3, 0.3)),
    texts=st.tuples(
        *[st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=255)] * 3
    ),
)
def test_any_parameters_come_back(
    weights: tuple[float, float, float, float],
    numbers: tuple[float, float, float],
    texts: tuple[str, str, str],
) -> None:
    """The decoded document equals the encoded one, for any values and texts."""
    zero_um, offset, scale = numbers
    update = {
        "right_stop_weights": weights[:2],
        "left_stop_weights": weights[2:],
        "created_by": texts[0],
    }
    axis = AxisParameters(
        model=MODEL.model_copy(update=update), zero_um=zero_um, offset=offset, scale=scale
    )
    document = ParameterDocument(
        sequence=3, stage=texts[1], saved_at="now", saved_by=texts[2], axes={"x": axis}
    )
    content = encode(document)

    assert decode(content).axes == document.axes
    assert encode(decode(content)) == content


@pytest.mark.fault("P13")
def test_newer_format_is_refused() -> None:
    """A file of a later version is refused."""
    newer = CONTENT.replace(b'"version": 1', b'"version": 2', 1)

    assert "version '2', this piezod reads version 1" in why_refused(newer)


@pytest.mark.fault("P6")
@pytest.mark.parametrize("step", ["write", "fsync", "rename"])
def test_failed_save_keeps_what_is_there(
    folder: Path, step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a full disk a save fails, leaves nothing behind, and the next one succeeds."""
    store = open_store(folder)
    store.save(parameters(1.0), "ann")
    before = sorted(folder.iterdir())

    def fail(*_arguments: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, step, fail)
        with pytest.raises(OSError, match="No space left"):
            store.save(parameters(2.0), "ann")

    assert sorted(folder.iterdir()) == before
    assert zero_of(store.load()) == 1.0
    assert store.save(parameters(3.0), "ann") == 2


def test_temporary_files_are_swept_up(folder: Path) -> None:
    """Opening a store removes the files that a killed process left."""
    open_store(folder).save(parameters(1.0), "ann")
    (folder / ".000000002.json.4711.part").write_bytes(b"half")
    store = open_store(folder)

    assert [path.name for path in folder.iterdir()] == ["000000001.json"]
    assert zero_of(store.load()) == 1.0
