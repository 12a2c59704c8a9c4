"""The chart of a soak."""

from collections.abc import Callable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezod.records.figures.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILLION,
    house_style,
    legend_above,
    new_figure,
)
from tests.soak.observer import LEARNED_PCT, Row


@house_style()
def soak_figure(rows: Sequence[Row], title: str, bounds_pct: float) -> Figure:
    """Draw what each simulated minute has shown."""
    figure = new_figure(10.0, 12.5, title, "")
    panels: Sequence[Axes] = figure.subplots(6, 1, sharex=True)
    hours = [row.hour for row in rows]

    def draw(axes: Axes, value: Callable[[Row], float], colour: str, label: str) -> None:
        axes.plot(hours, [value(row) for row in rows], color=colour, linewidth=1.0, label=label)

    error, drift, steps, memory, files, faults = panels
    draw(error, lambda row: row.error_max_pct, GREY, "largest of a minute")
    draw(error, lambda row: row.error_rms_pct, PURPLE, "rms of a minute")
    error.axhline(bounds_pct, color=VERMILLION, linewidth=0.8, label="bound of the rms")
    error.set(title="Error in mode adaptive, undisturbed", ylabel="% of range", ylim=(0, None))
    draw(drift, lambda row: row.drift_pct, GREEN, "end of a minute")
    drift.axhline(LEARNED_PCT, color=VERMILLION, linewidth=0.8, label="bound")
    drift.set(title="Learned model: difference of its drives from the identified one")
    drift.set(ylabel="% of range", ylim=(0, None))
    draw(steps, lambda row: row.amplifier_step_v, GREY, "by the amplifier")
    draw(steps, lambda row: row.piezod_step_v, PURPLE, "by piezod")
    steps.set(title="Largest step on the stage since the start", ylabel="V", ylim=(0, None))
    draw(memory, lambda row: row.rss_mb, BLUE, "")
    memory.set(title="Resident memory of the process", ylabel="MB")
    draw(files, lambda row: row.descriptors, BLUE, "descriptors")
    draw(files, lambda row: row.threads, ORANGE, "threads")
    draw(files, lambda row: row.files, GREY, "files of the stage")
    files.set(title="Descriptors, threads, files", ylim=(0, None))
    draw(faults, lambda row: row.faults, VERMILLION, "faults")
    draw(faults, lambda row: row.output_faults, ORANGE, "injected faults of the output")
    draw(faults, lambda row: row.daemons, BLUE, "starts of the daemon")
    faults.set(title="Since the start", ylim=(0, None), xlabel="simulated time (h)")
    for axes in (error, drift, steps, files, faults):
        legend_above(axes)
    return figure
