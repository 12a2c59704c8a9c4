"""The residuals of a fit, over the loop."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.figure import Figure
from matplotlib.text import Text

from piezod.records.experiment_result import Identification
from piezod.records.figures import identification_figure, png_bytes
from piezod.records.frozen import FloatArray


def loop(figure: Figure) -> Axes:
    """Return the panel with the residuals over the displacement."""
    (panel,) = [axes for axes in figure.axes if axes.get_title(loc="left") == "(d) Residual loop"]
    return panel


def drawn(panel: Axes, label: str) -> FloatArray:
    """Return the ordinates of a line, NaN where it is not drawn."""
    (line,) = [each for each in panel.lines if each.get_label() == label]
    return np.asarray(line.get_ydata(), dtype=np.float64)


def test_ways_up_and_down_are_told_apart(identification: Identification) -> None:
    """Each residual appears once, in the colour of the direction of its drive."""
    panel = loop(identification_figure(identification))

    up, down = drawn(panel, "rising"), drawn(panel, "falling")
    rises = np.gradient(identification.drive_v) >= 0.0
    assert np.array_equal(up[rises], identification.residual_v[rises])
    assert np.array_equal(down[~rises], identification.residual_v[~rises])
    assert np.all(np.isnan(up[~rises])) and np.all(np.isnan(down[rises]))
    colours = {
        line.get_color() for line in panel.lines if line.get_label() in {"rising", "falling"}
    }
    assert len(colours) == 2


def test_uncertainty_by_noise_is_shaded(identification: Identification) -> None:
    """The band has the given width around zero; samples without a width are left out."""
    band_v = np.full(identification.t_s.size, 0.25)
    band_v[:100] = np.nan

    panel = loop(identification_figure(identification, band_v))

    (band,) = [each for each in panel.collections if isinstance(each, FillBetweenPolyCollection)]
    heights = np.concatenate([path.vertices[:, 1] for path in band.get_paths()])  # type: ignore[index]  # an array
    assert (heights.min(), heights.max()) == (-0.25, 0.25)
    assert band.get_label() == "noise, 95 %"


@pytest.mark.parametrize("banded", [False, True])
def test_a_fit_of_which_part_does_not_count_is_drawn(
    identification: Identification, banded: bool
) -> None:
    """Samples without a prediction are a gap."""
    predicted_v = identification.predicted_v.copy()
    predicted_v[:50] = np.nan
    band_v = np.where(np.isfinite(predicted_v), 0.1, np.nan) if banded else None

    figure = identification_figure(replace(identification, predicted_v=predicted_v), band_v)

    assert png_bytes(figure).startswith(b"\x89PNG")


def test_headline_fits_on_a_line(identification: Identification) -> None:
    """Beside errors of the position there are rms errors only."""
    names = [f"{of}_error_{kind}_pct" for of in ("voltage", "position") for kind in ("max", "rms")]
    both = dict.fromkeys([*names, *(f"held_out_{name}" for name in names)], 0.5)

    figure = identification_figure(replace(identification, fit_errors=both))

    texts = " ".join(text.get_text() for text in figure.findobj(Text))
    assert "rms position error held out 0.50 %" in texts
    assert "worst" not in texts
