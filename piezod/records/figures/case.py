"""The figure of one case with all its modes on the same scales."""

from collections.abc import Callable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezod.records.experiment_result import Recording
from piezod.records.figures.overview import mode_marks
from piezod.records.figures.panels import draw_zero, headline, label_loop
from piezod.records.figures.style import (
    COMMAND,
    ERROR_LABEL,
    house_style,
    new_figure,
    round_time_ticks,
)
from piezod.records.figures.traces import draw_trace
from piezod.records.frozen import FloatArray

_UNCOMPENSATED = "uncompensated"


@house_style()
def case_figure(recordings: Sequence[Recording]) -> Figure:
    """Draw one case in all modes.

    Panels: (a) displacement, (b) error of all modes, (c) error without the uncompensated one, whose
    error is much larger, (d) measured displacement over uncompensated voltage. If the true
    displacement is known, the errors are the true ones.

    Args:
        recordings: The recordings of one axis and one case, at least one.
    """
    first = recordings[0]
    figure = new_figure(13.0, 8.0, headline(first, "all modes"), "")
    compensated = [each for each in recordings if each.mode != _UNCOMPENSATED]
    zoomed = bool(compensated) and len(compensated) < len(recordings)
    columns = figure.add_gridspec(1, 2, width_ratios=(1.35, 1.0))
    left = columns[0].subgridspec(2 + zoomed, 1)
    position, error = (figure.add_subplot(left[i]) for i in range(2))
    error.sharex(position)
    _draw(position, recordings, recordings, lambda each: each.position_um)
    draw_trace(position, first.t_s, first.command_um, **COMMAND)
    position.set(title="(a) Displacement; command dashed", ylabel="displacement (µm)")
    kind = "True error" if all(each.knows_truth for each in recordings) else "Error"
    _draw_errors(error, recordings, recordings)
    error.set_title(f"(b) {kind}")
    position.tick_params(labelbottom=False)
    last = error
    if zoomed:
        last = figure.add_subplot(left[2], sharex=position)
        _draw_errors(last, recordings, compensated)
        last.set_title(f"(c) {kind} of the compensated modes")
        error.tick_params(labelbottom=False)
    round_time_ticks(last)
    loop = figure.add_subplot(columns[1].subgridspec(1, 1)[0])
    for each, style in _styles(recordings, recordings):
        draw_trace(loop, each.uncompensated_v, each.position_um, label=each.mode, **style)
    label_loop(loop, f"({'d' if zoomed else 'c'}) Loop")
    loop.legend(loc="upper left")  # a loop leaves this corner free
    return figure


def _draw_errors(axes: Axes, all_modes: Sequence[Recording], drawn: Sequence[Recording]) -> None:
    true = all(each.knows_truth for each in all_modes)
    _draw(axes, all_modes, drawn, lambda each: each.true_error_um if true else each.error_um)
    draw_zero(axes)
    axes.set_ylabel(ERROR_LABEL)


def _draw(
    axes: Axes,
    all_modes: Sequence[Recording],
    drawn: Sequence[Recording],
    values: Callable[[Recording], FloatArray],
) -> None:
    for each, style in _styles(all_modes, drawn):
        draw_trace(axes, each.t_s, values(each), label=each.mode, **style)


def _styles(
    all_modes: Sequence[Recording], drawn: Sequence[Recording]
) -> list[tuple[Recording, dict[str, object]]]:
    """Return the recordings with the colours of their modes, which are the same in all panels."""
    marks = mode_marks(each.mode for each in all_modes)
    return [(each, {"color": marks[each.mode].colour, "linewidth": 1.0}) for each in drawn]
