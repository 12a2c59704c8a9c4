"""Output of an experiment in a folder: data and report."""

from pathlib import Path

from piezod.records.experiment_file import write_hdf5
from piezod.records.experiment_result import ExperimentResult
from piezod.records.reference import Reference
from piezod.records.report import write_report

DATA_NAME = "experiment.h5"


def write_outputs(
    folder: Path, result: ExperimentResult, reference: Reference | None, *, vector: bool = False
) -> Path:
    """Write the data file and the report with its figures; return the path of the report.

    Args:
        folder: Folder for the files; created if it is absent.
        result: The experiment.
        reference: Errors to compare with, if any.
        vector: Whether the figures are written as SVG and PDF, too.

    Raises:
        OSError: If a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_hdf5(folder / DATA_NAME, result)
    return write_report(folder, result, reference, vector=vector)
