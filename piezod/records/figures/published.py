"""A run drawn as its figure in the publication: figures 6 to 11 of the paper."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezod.records.experiment_result import Recording
from piezod.records.figures.panels import headline, label_loop
from piezod.records.figures.style import (
    COMMAND,
    DRIVE,
    LOOP,
    POSITION,
    house_style,
    legend_above,
    new_figure,
    round_time_ticks,
)
from piezod.records.figures.traces import draw_trace
from piezod.records.labels import metric_number, metric_text, metric_unit
from piezod.records.reference import Reference


@house_style()
def published_figure(recording: Recording, reference: Reference) -> Figure:
    """Draw the panels of the published figure, with our errors and the published one above.

    Panels: (a) uncompensated and compensated voltage over time, (b) measured displacement over
    time, (c) measured displacement over uncompensated voltage. All samples are drawn, also those
    that the metrics leave out.
    """
    title = f"As in {reference.figure(recording)} · {headline(recording, recording.mode)}"
    figure = new_figure(13.0, 6.2, title, compared_errors(recording, reference))
    columns = figure.add_gridspec(1, 2, width_ratios=(1.35, 1.0))
    left = columns[0].subgridspec(2, 1)
    voltage = figure.add_subplot(left[0])
    position = figure.add_subplot(left[1], sharex=voltage)
    _draw_voltages(voltage, recording)
    _draw_position(position, recording)
    _draw_loop(figure.add_subplot(columns[1].subgridspec(1, 1)[0]), recording)
    return figure


def compared_errors(recording: Recording, reference: Reference) -> str:
    """Return our errors that are compared, and the published one if it is known."""
    ours = ", ".join(
        metric_text(name, recording.metrics[name])
        for name in reference.metrics
        if name in recording.metrics
    )
    published = reference.value(recording)
    if published is None:
        return f"here: {ours}" if ours else ""
    name = reference.metrics[0]
    theirs = f"{reference.label}: {metric_number(name, published)} {metric_unit(name)}"
    return f"here: {ours} · {theirs}" if ours else theirs


def _draw_voltages(axes: Axes, recording: Recording) -> None:
    draw_trace(axes, recording.t_s, recording.uncompensated_v, label="uncompensated", **COMMAND)
    draw_trace(axes, recording.t_s, recording.drive_v, label="compensated", **DRIVE)
    axes.set(title="(a) Voltage", ylabel="voltage (V)")
    axes.tick_params(labelbottom=False)
    legend_above(axes)


def _draw_position(axes: Axes, recording: Recording) -> None:
    draw_trace(axes, recording.t_s, recording.position_um, **POSITION)
    axes.set(title="(b) Measured displacement", ylabel="displacement (µm)")
    round_time_ticks(axes)


def _draw_loop(axes: Axes, recording: Recording) -> None:
    draw_trace(axes, recording.uncompensated_v, recording.position_um, **LOOP)
    label_loop(axes, "(c) Measured displacement over uncompensated voltage")
