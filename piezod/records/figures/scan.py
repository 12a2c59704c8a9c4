"""The figure of a scan: its pictures, side by side."""

from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezod.records.figures.style import POSITION, house_style, new_figure
from piezod.records.frozen import FloatArray
from piezod.records.scan_file import BACKWARD, StoredScan

MOST_SHOWN: Final = 2000
"""Largest number of rows, and of columns, that are drawn."""


@house_style()
def scan_figure(scan: StoredScan) -> Figure:
    """Draw each picture of a scan; rows that were not swept yet stay empty."""
    count = len(scan.pictures)
    figure = new_figure(0.5 + 5.5 * count, 5.2, scan.title, "")
    for place, (name, picture) in enumerate(scan.pictures.items()):
        axes = figure.add_subplot(1, count, place + 1)
        way = "backward" if name.endswith(BACKWARD) else ""
        axes.set_title(" ".join(filter(None, (name.removesuffix(BACKWARD), way))))
        if picture.ndim == 1:
            _draw_curve(axes, scan, picture)
        else:
            _draw_picture(figure, axes, scan, picture)
    return figure


def _draw_curve(axes: Axes, scan: StoredScan, values: FloatArray) -> None:
    (name, scale_um), *_ = scan.scales
    axes.plot(scale_um, values, marker=".", **POSITION)
    axes.set_xlabel(_label(scan, name))


def _draw_picture(figure: Figure, axes: Axes, scan: StoredScan, picture: FloatArray) -> None:
    (of_rows, rows), (of_columns, columns) = scan.scales
    steps = [1 + (size - 1) // MOST_SHOWN for size in picture.shape]
    shown = picture[:: steps[0], :: steps[1]]
    axes.grid(visible=False)
    extent = (*_ends(columns), *_ends(rows))
    image = axes.imshow(shown, origin="lower", extent=extent, aspect="auto", cmap="viridis")
    if scan.units[of_rows] == scan.units[of_columns]:
        axes.set_aspect("equal")
    axes.set(xlabel=_label(scan, of_columns), ylabel=_label(scan, of_rows))
    figure.colorbar(image, ax=axes, shrink=0.8)


def _ends(centres: FloatArray) -> tuple[float, float]:
    """Return the outer edges of pixels with these centres."""
    half = 0.5 * float(centres[1] - centres[0]) if centres.size > 1 else 0.5
    return float(centres[0]) - half, float(centres[-1]) + half


def _label(scan: StoredScan, scale: str) -> str:
    unit = scan.units[scale].replace("u", "µ", 1)
    return f"{scale.removesuffix('_um')} ({unit})" if unit else scale
