"""Records that cannot be used have one error each, with the row and a remedy."""

from pathlib import Path

import numpy as np
import pytest

from piezod.errors import DataError
from piezod.reading.record import read_record
from piezod.reading.table import FloatArray
from tests.reading.lab import DRIVE_V, POSITION_UM, T_S, rows, write

HEADER = "t_s,drive_v,position_um\n"
PERIOD_UM = 4.0
WRAPPED_UM = POSITION_UM % PERIOD_UM


def _outliers() -> FloatArray:
    column = POSITION_UM.copy()
    column[[60, 200, 310]] += 500.0
    return column


def _steps() -> FloatArray:
    return np.where(np.arange(T_S.size) % 50 < 25, 100.0, 0.0)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ((T_S[::-1], DRIVE_V, POSITION_UM), r"a\.csv:3: t_s 0.398 comes after 0.399"),
        ((T_S, 0.0 * T_S, POSITION_UM), "drive_v is 0.0 in all 400 samples"),
        ((T_S, DRIVE_V, 0.0 * T_S), "position_um is 0.0 in all 400 samples"),
        ((T_S, DRIVE_V, WRAPPED_UM), r"a\.csv:31: position_um jumps by -3.*period=4[.)]"),
    ],
)
def test_bad_record_is_refused(tmp_path: Path, columns: tuple[FloatArray, ...], said: str) -> None:
    """Backward time, constant columns and a wrapped interferometer."""
    path = write(tmp_path / "a.csv", HEADER + rows(*columns))

    with pytest.raises(DataError, match=said):
        read_record(path)


@pytest.mark.parametrize(
    "columns",
    [
        (T_S, DRIVE_V, _outliers()),
        (T_S, _steps(), 0.2 * _steps()),
        (T_S, DRIVE_V, np.random.default_rng(1).standard_normal(T_S.size)),
    ],
)
def test_other_jumps_are_no_wraps(tmp_path: Path, columns: tuple[FloatArray, ...]) -> None:
    """Outliers, steps of the drive and noise are read: other checks judge them."""
    path = write(tmp_path / "a.csv", HEADER + rows(*columns))

    assert read_record(path).columns["position_um"].tolist() == columns[2].tolist()
