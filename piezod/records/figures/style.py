"""Common appearance of all figures: colours, sizes, and PNG output."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Figure  # noqa: PLC0414 - this room has matplotlib for all
from matplotlib.legend_handler import HandlerTuple
from matplotlib.ticker import MaxNLocator

from piezod.records.atomic import replacing

# The palette of Okabe and Ito, which most colour-blind people can distinguish.
BLACK: Final = "#000000"
BLUE: Final = "#0072B2"
GREEN: Final = "#009E73"
VERMILLION: Final = "#D55E00"
PURPLE: Final = "#CC79A7"
ORANGE: Final = "#E69F00"
GREY: Final = "#767676"

# A command is black and dashed; a measured or applied quantity is solid, in its own colour.
COMMAND: Final[dict[str, Any]] = {"color": BLACK, "linewidth": 0.9, "linestyle": (0, (4, 2))}
DRIVE: Final[dict[str, Any]] = {"color": VERMILLION, "linewidth": 1.5}
POSITION: Final[dict[str, Any]] = {"color": BLUE, "linewidth": 1.5}
LOOP: Final[dict[str, Any]] = {"color": BLUE, "linewidth": 1.0}
ERROR_LABEL: Final = "command −\nposition (µm)"
"""What an error is, everywhere; in two lines, which fit beside a low panel."""
ERROR: Final[dict[str, Any]] = {"color": PURPLE, "linewidth": 0.7}
# The true error lies within the noise of the measured one: darker, and drawn on top.
TRUE_ERROR: Final[dict[str, Any]] = {"color": "#6B2149", "linewidth": 0.9}
ERROR_DOTS: Final[dict[str, Any]] = {
    "color": PURPLE, "linestyle": "", "marker": ".", "markersize": 3.0, "markeredgewidth": 0.0,
}  # fmt: skip
EXCLUDED: Final[dict[str, Any]] = {"color": "#B0B0B0", "linewidth": 0.9}
# A thin line on top of a broad one: both stay visible if they coincide.
BROAD_DRIVE: Final[dict[str, Any]] = {"color": ORANGE, "linewidth": 2.6}
PREDICTED: Final[dict[str, Any]] = {"color": BLUE, "linewidth": 0.7}

_DOTS_PER_INCH: Final = 125
_LAYOUT: Final = "constrained"
_SETTINGS: Final[dict[Any, Any]] = {
    "text.parse_math": False,  # a $ in a title or a file name is a plain character
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 10.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.xmargin": 0.01,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "legend.handlelength": 2.2,
    "lines.solid_joinstyle": "round",
    "figure.constrained_layout.w_pad": 0.07,
    "figure.constrained_layout.h_pad": 0.05,
    "figure.dpi": _DOTS_PER_INCH,
    "savefig.dpi": _DOTS_PER_INCH,
}


@contextmanager
def house_style() -> Iterator[None]:
    """Draw with these settings on top of matplotlib's defaults, without the user's matplotlibrc."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        yield


def new_figure(width_in: float, height_in: float, title: str, subtitle: str) -> Figure:
    """Return an empty figure with a headline at its upper left.

    Args:
        width_in: Width in inches.
        height_in: Height in inches.
        title: First line of the headline.
        subtitle: Second line; empty for none.
    """
    figure = Figure(figsize=(width_in, height_in), layout=_LAYOUT)
    FigureCanvasAgg(figure)
    heading = "\n".join(filter(None, (title, subtitle)))
    figure.suptitle(heading, x=0.008, ha="left", fontsize=12, linespacing=1.5)
    return figure


def round_time_ticks(axes: Axes) -> None:
    """Label the abscissa, time in s, with ticks at round values."""
    axes.set_xlabel("time (s)")
    axes.xaxis.set_major_locator(MaxNLocator(nbins=10, steps=[1, 2, 5, 10]))


def legend_above(axes: Axes, entries: Mapping[str, tuple[Artist, ...]] | None = None) -> None:
    """Put the legend beside the panel's title, where it covers no data.

    Args:
        axes: A panel whose title is at the left and leaves room.
        entries: Entries of the legend, artists side by side; by default all artists with a label.
    """
    if entries is None:
        handles, labels = axes.get_legend_handles_labels()
        entries = {label: (handle,) for handle, label in zip(handles, labels, strict=True)}
    axes.legend(
        handles=list(entries.values()),
        labels=list(entries),
        handler_map={tuple: HandlerTuple(ndivide=None, pad=0)},
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=len(entries),
        borderaxespad=0.1,
        columnspacing=1.3,
    )


def add_percent_axis(axes: Axes, full_range: float, label: str) -> None:
    """Add a right-hand axis in percent of a range; no axis for a range of 0.

    Args:
        axes: The panel.
        full_range: Value of 100 %, in the unit of the ordinate.
        label: Label of the axis.
    """
    if full_range <= 0:
        return

    def to_percent(values: Any) -> Any:
        return 100.0 * values / full_range

    def from_percent(percents: Any) -> Any:
        return percents * full_range / 100.0

    axes.secondary_yaxis("right", functions=(to_percent, from_percent)).set_ylabel(label)


@house_style()
def png_bytes(figure: Figure) -> bytes:
    """Return a figure as PNG; the bytes are reproducible."""
    buffer = BytesIO()
    # Without this, the version of matplotlib is written into the file.
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


FORMATS: Final = {
    ".png": {"Software": None},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}
"""Endings of figure files, each with the metadata that would differ from run to run."""


@house_style()
def save_figure(path: Path, figure: Figure) -> None:
    """Write a figure in the format of the file's ending, one of `FORMATS`.

    Args:
        path: Path of the file; it is written completely or not at all.
        figure: The figure.

    Raises:
        OSError: If the file cannot be written.
    """
    with replacing(path) as temporary:
        kind = path.suffix.lower()
        figure.savefig(temporary, format=kind[1:], metadata=FORMATS[kind])


def save_vector(png: Path, figure: Figure) -> None:
    """Write a figure as SVG and as PDF beside its PNG.

    Args:
        png: Path of the PNG, which gives folder and name.
        figure: The figure.

    Raises:
        OSError: If a file cannot be written.
    """
    for ending in FORMATS:
        if ending != ".png":
            save_figure(png.with_suffix(ending), figure)


def save_png(path: Path, figure: Figure) -> None:
    """Write a figure as PNG.

    Args:
        path: Path of the file; it is written completely or not at all.
        figure: The figure.

    Raises:
        OSError: If the file cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(png_bytes(figure))
