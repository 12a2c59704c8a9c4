"""Damaged recordings end each command with a sentence, never with a traceback."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from piezod.cli.output import new_console
from piezod.cli.record.show_view import as_document, print_summary
from piezod.config.modes import Mode
from piezod.errors import PiezodError
from piezod.experiment.fit.recorded import columns_of_recording, delay_of_recording
from piezod.experiment.replay.recorded_axis import recorded_axis
from piezod.records.figures.telemetry import COLUMNS, telemetry_figure
from piezod.records.recording.export import export_table
from piezod.records.recording.reader import read_telemetry
from piezod.records.recording.summary import summary_of
from piezod.records.view import view
from piezod.records.view_parts import contents, loop, marks
from tests.recorded import new_stage, run_modes, write_recording
from tests.records.damage import damage


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a good recording of a stage."""
    path = tmp_path_factory.mktemp("good") / "rec.h5"
    stage = new_stage()
    run_modes(stage, (Mode.FEEDFORWARD,))
    write_recording(path, stage)
    return path


def _show(path: Path) -> None:
    summary = summary_of(path)
    as_document(path, 1, summary)
    print_summary(new_console(), path, 1, summary, 5)


def _replay(path: Path) -> None:
    telemetry = read_telemetry(path)
    recorded_axis(telemetry, telemetry.chosen_axis(None))
    telemetry.header.configuration()
    telemetry.model_text(telemetry.chosen_axis(None))


def _identify(path: Path) -> None:
    columns_of_recording(path, None)
    delay_of_recording(path, None)


def _plot(path: Path) -> None:
    telemetry = read_telemetry(path, columns=COLUMNS)
    telemetry_figure(telemetry, telemetry.chosen_axis(None))


def _page(path: Path) -> None:
    axis = contents(path).axes[0]
    view(path, f"axis_{axis}/position_um")
    marks(path, axis)
    loop(path, axis)


USES: tuple[Callable[[Path], object], ...] = (
    _show,
    _replay,
    _identify,
    _page,
    lambda path: export_table(path.with_suffix(".csv"), path, ("x",)),
)


def survive(good: Path, path: Path, seed: int, uses: tuple[Callable[[Path], object], ...]) -> None:
    """Use a damaged copy in each way; only documented errors are raised."""
    shutil.copy(good, path)
    what = damage(path, seed)
    for use in uses:
        try:
            use(path)
        except PiezodError:
            continue
        except Exception as error:
            error.add_note(f"seed {seed}, {what}")
            raise


@pytest.mark.parametrize("seed", range(25))
@pytest.mark.few(6)
def test_damaged_recording_is_read_or_refused(recording: Path, tmp_path: Path, seed: int) -> None:
    """One wrong value, shape, type, attribute, text or missing part is no traceback."""
    survive(recording, tmp_path / "rec.h5", seed, USES)


@pytest.mark.stress
def test_many_damaged_recordings_are_read_or_refused(recording: Path, tmp_path: Path) -> None:
    """The same for many more, and for figures."""
    for seed in range(1000, 3000):
        survive(recording, tmp_path / f"rec-{seed}.h5", seed, (*USES, _plot))
        (tmp_path / f"rec-{seed}.h5").unlink()
