"""The figures of a report: drawing, file names and descriptions."""

import re
import struct
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain, count
from typing import NamedTuple, Self

from piezod.records.experiment_result import ExperimentResult, Identification, Recording
from piezod.records.figures import (
    case_figure,
    identification_figure,
    mode_figure,
    overview_figure,
    png_bytes,
    published_figure,
    remaining_figure,
)
from piezod.records.figures.published import compared_errors
from piezod.records.figures.style import Figure
from piezod.records.labels import metric_text
from piezod.records.reference import Reference


@dataclass(frozen=True)
class ReportFigure:
    """A drawn figure."""

    name: str  #: Name of its file without suffix; also its anchor in the page.
    title: str  #: Heading above it.
    alt: str  #: Description for readers who cannot see it.
    figure: Figure = field(repr=False, compare=False)  #: What is drawn, for vector files.
    png: bytes = field(repr=False)  #: The image.
    #: Figure with the other panels of the same run, if there is one.
    rest: "ReportFigure | None" = None

    @classmethod
    def drawn(
        cls, name: str, title: str, alt: str, figure: Figure, rest: "ReportFigure | None" = None
    ) -> Self:
        """Return a figure with its image."""
        return cls(name, title, alt, figure, png_bytes(figure), rest)

    @property
    def base64(self) -> str:
        """The image as text for a data address."""
        return b64encode(self.png).decode("ascii")

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height in pixels, from the header of the image."""
        # A PNG begins with 8 bytes of signature and 8 of the header's length and type.
        width, height = struct.unpack(">II", self.png[16:24])
        return width, height


class Gallery(NamedTuple):
    """All figures of a report."""

    overview: (
        ReportFigure | None
    )  #: Comparison of all modes; None if there is no metric to compare.
    #: Runs drawn as their figures in the publication, in the order of the modes, which is that of
    #: the paper.
    published: tuple[ReportFigure, ...]
    #: Models and the records that they were fitted to; models from files have no figure.
    models: tuple[ReportFigure, ...]
    #: Figures of the modes by (axis, case); only error and parameters if `published` has the rest.
    runs: dict[tuple[str, str], tuple[ReportFigure, ...]]
    #: Figure of all modes by (axis, case), for cases with several.
    cases: dict[tuple[str, str], ReportFigure]

    def all(self) -> tuple[ReportFigure, ...]:
        """Return every figure, in the order of the page."""
        first = () if self.overview is None else (self.overview,)
        runs = chain.from_iterable(self.runs.values())
        return (*first, *self.published, *self.models, *self.cases.values(), *runs)


def draw_gallery(result: ExperimentResult, reference: Reference | None = None) -> Gallery:
    """Draw all figures of an experiment."""
    number = count(1)
    fitted = [each for each in result.identifications if each.t_s.size]
    published = _published(result, reference) if reference else {}
    return Gallery(
        _overview(result, reference) if result.metric_names else None,
        tuple(published.values()),
        tuple(_model(index, each) for index, each in enumerate(fitted, 1)),
        {
            key: tuple(_run(next(number), each, published.get(each.key)) for each in recordings)
            for key, recordings in result.by_case().items()
        },
        {
            key: _case(index, recordings)
            for index, (key, recordings) in enumerate(result.by_case().items(), 1)
            if len(recordings) > 1
        },
    )


def _overview(result: ExperimentResult, reference: Reference | None) -> ReportFigure:
    alt = (
        f"The errors of {len(result.recordings)} runs as dots, a panel for each metric; "
        "the table of errors holds the same figures."
    )
    return ReportFigure.drawn("overview", "", alt, overview_figure(result, reference))


def _model(number: int, identification: Identification) -> ReportFigure:
    name = _file_name(f"model_{number}", identification.axis)
    title = f"Axis {identification.axis}: {identification.title}"
    figure = identification_figure(identification)
    return ReportFigure.drawn(name, title, _fit_alt(identification), figure)


def _case(number: int, recordings: Sequence[Recording]) -> ReportFigure:
    axis, case, _ = recordings[0].key
    modes = ", ".join(each.mode for each in recordings)
    alt = f"Displacement, error and loop of {case} in the modes {modes}, on the same scales."
    name = _file_name(f"case_{number:02d}", axis, case)
    return ReportFigure.drawn(name, "all modes", alt, case_figure(recordings))


def _published(
    result: ExperimentResult, reference: Reference
) -> dict[tuple[str, str, str], ReportFigure]:
    """Return the published figures by the key of their run."""
    drawn = (
        each
        for mode in result.modes
        for each in result.recordings
        if each.mode == mode and reference.figure(each)
    )
    return {
        each.key: ReportFigure.drawn(
            _file_name(f"published_{number:02d}", *each.key),
            f"As in {reference.figure(each)}: {each.case}, {each.mode}",
            f"Voltages and displacement over time, and the displacement over the uncompensated "
            f"voltage, of {each.case}, mode {each.mode}; {compared_errors(each, reference)}.",
            published_figure(each, reference),
        )
        for number, each in enumerate(drawn, 1)
    }


def _run(number: int, recording: Recording, published: ReportFigure | None) -> ReportFigure:
    name = _file_name(f"run_{number:02d}", *recording.key)
    draw, panels = mode_figure, ["voltage", "displacement", "loop", "error"]
    if published is not None:
        draw, panels = remaining_figure, ["error"]
    if recording.weights.size:
        panels.append("parameters")
    shown = " and ".join(filter(None, (", ".join(panels[:-1]), panels[-1]))).capitalize()
    alt = f"{shown} of {recording.case}, mode {recording.mode}"
    errors = [metric_text(*item) for item in recording.metrics.items()]
    what = name, recording.mode, _sentence(alt, errors)
    return ReportFigure.drawn(*what, draw(recording), published)


def figures_in(page: str) -> list[str]:
    """Return the names of the figures of a page; empty if it is not a report of piezod."""
    return re.findall(
        r'^<figure id="((?:overview|published_\d\d|model_\d|case_\d\d|run_\d\d)[A-Za-z0-9_-]*)">$',
        page,
        re.M,
    )


def _file_name(*parts: str) -> str:
    # The number in front keeps names apart that are equal after the replacement.
    return re.sub(r"[^A-Za-z0-9_-]+", "_", "_".join(parts))


def _fit_alt(identification: Identification) -> str:
    errors = [metric_text(*item) for item in identification.fit_errors.items()]
    shown = "Measured and predicted drive voltage over time and as a loop, and their difference"
    return _sentence(shown, errors)


def _sentence(shown: str, errors: list[str]) -> str:
    return f"{shown}: {', '.join(errors)}." if errors else f"{shown}."
