"""The figure of a frequency response: Bode plot, coherence, noise and step response."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from piezod.dynamics.fit_problem import RINGS_BELOW
from piezod.dynamics.measured import MeasuredResponse
from piezod.dynamics.steps import predicted_step
from piezod.records.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    PURPLE,
    VERMILLION,
    house_style,
    legend_above,
    new_figure,
)
from piezod.records.response_record import AboutVoltage, ResponseRecord

_COLOURS: Final = (BLUE, VERMILLION, GREEN, PURPLE)
_CURVE_POINTS: Final = 2000
_PLAIN: Final = FuncFormatter(lambda value, _: f"{value:g}")
"""Powers of ten as plain numbers."""
_DOTS: Final[dict[str, Any]] = {"linestyle": "", "marker": ".", "markersize": 5.0}
_NOT_USED: Final[dict[str, Any]] = {**_DOTS, "color": "#B8B8B8", "markersize": 3.5}
_MODEL: Final[dict[str, Any]] = {"color": BLACK, "linewidth": 1.1}
_MODE: Final[dict[str, Any]] = {"color": GREY, "linewidth": 0.8, "linestyle": (0, (2, 3))}
_BELOW, _ABOVE = 0.3, 2.0
"""The magnitude is shown from and to these multiples of the smallest and largest of the fit."""
_STEP_TIMES: Final = 6.0
"""The step response is shown for this multiple of the slowest decay."""


@house_style()
def response_figure(record: ResponseRecord) -> Figure:
    """Draw a measured response and its model.

    At the left, over the frequency: (a) magnitude and (b) phase with a static gain of one, (c)
    coherence. At the right: (d) noise of the displacement, (e) step response. Lines that are not
    clear of the noise are grey.
    """
    title = f"Response by {record.method} · axis {record.axis}: {record.title}"
    figure = new_figure(13.0, 8.0, title, "\n".join(filter(None, _headline(record))))
    grid = figure.add_gridspec(6, 2, width_ratios=(1.5, 1.0))
    magnitude = figure.add_subplot(grid[:3, 0])
    phase = figure.add_subplot(grid[3:5, 0], sharex=magnitude)
    coherence = figure.add_subplot(grid[5, 0], sharex=magnitude)
    noise, step = figure.add_subplot(grid[:3, 1]), figure.add_subplot(grid[3:, 1])
    _draw_bode(magnitude, phase, record)
    _draw_coherence(coherence, record)
    _draw_noise(noise, record)
    _draw_step(step, record)
    for axes in (magnitude, phase):
        axes.tick_params(labelbottom=False)
    for axes in (magnitude, phase, coherence, noise):
        axes.xaxis.set_major_formatter(_PLAIN)
    for axes in (magnitude, noise):
        axes.yaxis.set_major_formatter(_PLAIN)
        axes.yaxis.set_minor_formatter(NullFormatter())
    for mode in record.fit.model.resonances:
        if mode.damping < RINGS_BELOW:
            for axes in (magnitude, phase, coherence, noise):
                axes.axvline(mode.frequency_hz, **_MODE)
    return figure


def _headline(record: ResponseRecord) -> tuple[str, str]:
    """Return a line with delay and gains, and one with the resonances."""
    fit = record.fit
    slow = [f"delay {1e3 * fit.model.delay_s:.3g} ± {1e3 * fit.delay_uncertainty_s:.1g} ms"]
    for about, (gain, uncertain) in zip(record.about, fit.gains, strict=True):
        slow.append(f"{gain:.4g} ± {uncertain:.1g} µm/V about {about.offset_v:.4g} V")
    modes = []
    for mode, own in zip(fit.model.resonances, fit.uncertainties, strict=True):
        kind = "mode" if mode.damping < RINGS_BELOW else "filter"
        # Two digits of the uncertainty, without an exponent.
        uncertainty = f"{float(f'{own[0]:.2g}'):g}"
        modes.append(
            f"{kind} {mode.frequency_hz:.5g} ± {uncertainty} Hz, damping {mode.damping:.3g}"
        )
    return " · ".join(slow), " · ".join(modes)


def _draw_bode(magnitude: Axes, phase: Axes, record: ResponseRecord) -> None:
    fit = record.fit
    for index, (about, colour) in enumerate(_coloured(record)):
        lines, clear = (
            about.response,
            np.isin(about.response.frequency_hz, fit.used[index].frequency_hz),
        )
        model = fit.model.at(lines.frequency_hz)
        # The hold changes each line as it changes the model.
        measured = lines.response / fit.fitted(index, lines.frequency_hz) * model
        label = f"about {about.offset_v:.4g} V"
        style = {**_DOTS, "color": colour, "label": label}
        magnitude.loglog(lines.frequency_hz[~clear], np.abs(measured[~clear]), **_NOT_USED)
        magnitude.errorbar(
            lines.frequency_hz[clear],
            np.abs(measured[clear]),
            _bars(lines, clear) * np.abs(measured[clear]),
            elinewidth=0.7,
            **style,
        )
        # The phase of the model decides between angles that differ by whole turns.
        expected = _unwrapped_deg(record, lines.frequency_hz)
        off = np.degrees(np.angle(measured / model))
        phase.semilogx(lines.frequency_hz[clear], (expected + off)[clear], **style)
    f = _curve_hz(record)
    magnitude.loglog(f, np.abs(fit.model.at(f)), label="model", **_MODEL)
    phase.semilogx(f, _unwrapped_deg(record, f), **_MODEL)
    shown = [np.abs(fit.model.at(each)) for each in (*(one.frequency_hz for one in fit.used), f)]
    lowest = min(float(each.min()) for each in shown[:-1])
    magnitude.set_ylim(_BELOW * lowest, _ABOVE * max(float(each.max()) for each in shown))
    magnitude.set_title("(a) Magnitude")
    magnitude.set_ylabel("magnitude, static = 1")
    legend_above(magnitude)
    phase.set(title="(b) Phase", ylabel="phase (°)")


def _draw_coherence(axes: Axes, record: ResponseRecord) -> None:
    for about, colour in _coloured(record):
        axes.semilogx(
            about.response.frequency_hz, about.response.coherence, color=colour, linewidth=1.2
        )
    axes.set(title="(c) Coherence", ylim=(0.0, 1.05), xlabel="frequency (Hz)")


def _draw_noise(axes: Axes, record: ResponseRecord) -> None:
    for about, colour in _coloured(record):
        axes.loglog(about.noise_hz, 1e3 * about.noise_um_per_rthz, color=colour, linewidth=1.0)
    axes.set(title="(d) Noise of the displacement", ylabel="nm/√Hz", xlabel="frequency (Hz)")


def _draw_step(axes: Axes, record: ResponseRecord) -> None:
    end_s = _step_s(record)
    for about, colour in _coloured(record):
        if about.step is not None:
            shown = about.step.t_s <= end_s
            label = f"mean of {about.step.steps} steps"
            style = {**_DOTS, "color": colour, "label": label}
            axes.plot(1e3 * about.step.t_s[shown], about.step.answer[shown], **style)
    t_s = np.linspace(0.0, end_s, _CURVE_POINTS)
    axes.plot(1e3 * t_s, predicted_step(record.fit.model, t_s), label="model", **_MODEL)
    axes.set(title="(e) Step", xlabel="time (ms)", ylabel="displacement, end = 1")
    legend_above(axes)


def _coloured(record: ResponseRecord) -> Iterator[tuple[AboutVoltage, str]]:
    for index, about in enumerate(record.about):
        yield about, _COLOURS[index % len(_COLOURS)]


def _bars(lines: MeasuredResponse, clear: Any) -> Any:
    return lines.relative_uncertainty[clear] / np.sqrt(2.0)


def _curve_hz(record: ResponseRecord) -> Any:
    lines = [about.response.frequency_hz for about in record.about]
    low, high = min(each[0] for each in lines), max(each[-1] for each in lines)
    return np.geomspace(low, high, _CURVE_POINTS)


def _unwrapped_deg(record: ResponseRecord, frequency_hz: Any) -> Any:
    """Return the phase of the model in °, continuous from zero frequency on."""
    f = np.geomspace(1e-3 * frequency_hz[0], frequency_hz[-1], 4 * _CURVE_POINTS)
    return np.interp(frequency_hz, f, np.degrees(np.unwrap(np.angle(record.fit.model.at(f)))))


def _step_s(record: ResponseRecord) -> float:
    """Return how long the step response is shown, in s."""
    model = record.fit.model
    decays_s = [1.0 / (2.0 * np.pi * mode.frequency_hz * mode.damping) for mode in model.resonances]
    shown_s = model.delay_s + _STEP_TIMES * max(decays_s, default=model.delay_s / _STEP_TIMES)
    steps = [about.step.t_s for about in record.about if about.step is not None]
    shown_s = max(shown_s, *(10.0 * each[0] for each in steps))
    return float(min([shown_s, *(each[-1] for each in steps)]))
