"""The report of an experiment: one self-contained HTML page, and its figures as PNG."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from piezod.records.atomic import replacing
from piezod.records.error_table import error_table, groups, meaning, verdict
from piezod.records.experiment_result import ExperimentResult
from piezod.records.figures.style import FORMATS, save_vector
from piezod.records.labels import metric_heading, metric_label, metric_number, metric_unit
from piezod.records.page import render
from piezod.records.reference import Reference
from piezod.records.report_figures import draw_gallery, figures_in

REPORT_NAME: Final = "report.html"
_TEMPLATE: Final = "report.html.jinja"
_FILTERS: Final[dict[str, Callable[..., str]]] = {
    "heading": metric_heading,
    "label": metric_label,
    "number": metric_number,
    "unit": metric_unit,
}


def write_report(
    folder: Path,
    result: ExperimentResult,
    reference: Reference | None = None,
    *,
    vector: bool = False,
) -> Path:
    """Write the page, and each of its figures beside it.

    Figures of an earlier report in the folder that this report lacks are removed.

    Args:
        folder: Folder of the report; created if it is absent.
        result: The experiment.
        reference: Errors to compare with, if any.
        vector: Whether the figures are written as SVG and PDF, too.

    Returns:
        Path of the page.

    Raises:
        OSError: If the files cannot be written.
    """
    path = folder / REPORT_NAME
    earlier = _figures_beside(path)
    gallery = draw_gallery(result, reference)
    table = error_table(result, reference)
    for figure in gallery.all():
        with replacing(folder / f"{figure.name}.png") as temporary:
            temporary.write_bytes(figure.png)
        if vector:
            save_vector(folder / f"{figure.name}.png", figure.figure)
    page = render(
        _TEMPLATE,
        _FILTERS,
        result=result,
        reference=reference,
        table=table,
        verdict=verdict(table, reference),
        groups=groups(result.metric_names),
        meaning=meaning(result.metric_names),
        gallery=gallery,
    )
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    # Last, so that an interrupted run leaves no page that refers to a removed figure.
    for name in earlier - {figure.name for figure in gallery.all()}:
        for ending in FORMATS:
            (folder / f"{name}{ending}").unlink(missing_ok=True)
    return path


def _figures_beside(path: Path) -> set[str]:
    """Return the names of the figures of a report; empty if there is no report."""
    if not path.exists():
        return set()
    return set(figures_in(path.read_text(encoding="utf-8", errors="replace")))
