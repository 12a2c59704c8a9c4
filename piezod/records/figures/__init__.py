"""Figures of records, each drawn on its own canvas: no window, no global plot."""

from importlib.util import find_spec

from piezod.errors import FiguresMissingError

if find_spec("matplotlib") is None:
    raise FiguresMissingError(
        "drawing needs matplotlib, which is not installed: pip install 'piezod[figures]'"
    )

from piezod.records.figures.case import case_figure
from piezod.records.figures.fit import identification_figure
from piezod.records.figures.overview import overview_figure
from piezod.records.figures.published import published_figure
from piezod.records.figures.run import mode_figure, remaining_figure
from piezod.records.figures.style import png_bytes, save_png

__all__ = [
    "case_figure",
    "identification_figure",
    "mode_figure",
    "overview_figure",
    "png_bytes",
    "published_figure",
    "remaining_figure",
    "save_png",
]
