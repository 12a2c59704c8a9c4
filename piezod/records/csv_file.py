"""CSV output: named columns of numbers over time, `t_s, drive_v, position_um, …`."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from piezod.records.atomic import replacing


def write_csv(path: Path, columns: Mapping[str, npt.ArrayLike]) -> None:
    """Write columns such that reading them returns the same numbers to the last bit.

    Args:
        path: Path of the file; it is written completely or not at all.
        columns: Columns by name, each of shape (n_samples,): numbers, or texts without commas.

    Raises:
        ValueError: If the columns differ in length.
        OSError: If the file cannot be written.
    """
    write_csv_portions(path, [columns])


def write_csv_portions(path: Path, portions: Iterable[Mapping[str, npt.ArrayLike]]) -> None:
    """Write columns that come in portions; arguments and errors are those of `write_csv`."""
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        for number, columns in enumerate(portions):
            if not number:
                file.write(",".join(columns) + "\n")
            rows = map(",".join, zip(*map(_texts, columns.values()), strict=True))
            file.writelines(f"{row}\n" for row in rows)


def _texts(column: npt.ArrayLike) -> list[str]:
    values = np.asarray(column)
    if values.dtype.kind == "b":
        values = values.astype(np.int8)  # 0 and 1, which every program reads as numbers
    # repr is the shortest text that reads back as the same double.
    spell = repr if values.dtype.kind == "f" else str
    return [spell(value) for value in values.tolist()]
