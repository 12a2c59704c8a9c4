"""Figures of an acceptance sheet."""

from collections.abc import Iterator

import numpy as np

from piezod.commission.procedure import Findings
from piezod.commission.session_trace import SessionTrace
from piezod.records.figures.style import DRIVE, LOOP, POSITION, Figure, house_style, new_figure
from piezod.records.report_figures import ReportFigure

_WIDTH_IN, _HEIGHT_IN = 9.0, 3.6


def draw(findings: Findings) -> Iterator[ReportFigure]:
    """Yield a figure for each step with a record."""
    traces = findings.traces
    if "noise" in traces:
        yield _over_time("noise", "Noise at rest", traces["noise"], drive=False)
    if "polarity" in traces:
        yield _over_time("polarity", "Polarity", traces["polarity"], drive=True)
    if "travel" in traces:
        yield _loop(traces["travel"])
    if findings.response is not None:
        yield _phases(findings)
    if "ringing" in traces:
        yield _rings(traces["ringing"])


def _over_time(name: str, title: str, trace: SessionTrace, *, drive: bool) -> ReportFigure:
    with house_style():
        figure = new_figure(_WIDTH_IN, _HEIGHT_IN * (1.5 if drive else 1.0), "", "")
        panels = figure.subplots(2 if drive else 1, 1, sharex=True, squeeze=False)[:, 0]
        panels[0].plot(trace.t_s, trace.position_um, **POSITION | {"linewidth": 0.8})
        panels[0].set_ylabel("position (µm)")
        if drive:
            panels[1].plot(trace.t_s, trace.drive_v, **DRIVE)
            panels[1].set_ylabel("drive (V)")
        panels[-1].set_xlabel("time (s)")
        return _drawn(name, title, "position over time", figure)


def _loop(trace: SessionTrace) -> ReportFigure:
    with house_style():
        figure = new_figure(_WIDTH_IN, 1.4 * _HEIGHT_IN, "", "")
        loop, amplifier = figure.subplots(1, 2)
        loop.plot(trace.drive_v, trace.position_um, **LOOP)
        loop.set_xlabel("drive (V)")
        loop.set_ylabel("position (µm)")
        amplifier.plot(
            trace.drive_v, trace.read_back_v - trace.drive_v, **DRIVE | {"linewidth": 0.6}
        )
        amplifier.set_xlabel("drive (V)")
        amplifier.set_ylabel("read back − written (V)")
        return _drawn("travel", "Travel", "position against drive: a loop", figure)


def _phases(findings: Findings) -> ReportFigure:
    response = findings.response
    assert response is not None  # noqa: S101 - the caller has checked it
    with house_style():
        figure = new_figure(_WIDTH_IN, _HEIGHT_IN, "", "the slope is the delay")
        panel = figure.subplots()
        panel.plot(response.frequencies_hz, response.lag_deg, "o", color=POSITION["color"])
        line_hz = np.array([0.0, response.frequencies_hz[-1]])
        slope = 360.0 * response.delay_s
        # The line of the fit: its slope is the delay, its mean deviation from the points is 0.
        at_zero = float(np.mean(response.lag_deg - slope * response.frequencies_hz))
        panel.plot(line_hz, at_zero + slope * line_hz, **LOOP)
        panel.set_xlabel("frequency (Hz)")
        panel.set_ylabel("lag (°)")
        return _drawn("delay", "Delay", "lag against frequency: a straight line", figure)


def _rings(trace: SessionTrace) -> ReportFigure:
    with house_style():
        figure = new_figure(_WIDTH_IN, _HEIGHT_IN, "", "the first steps of many")
        panel = figure.subplots()
        shown = trace.t_s < 0.5
        panel.plot(trace.t_s[shown], trace.position_um[shown], **POSITION | {"linewidth": 0.8})
        panel.set_xlabel("time (s)")
        panel.set_ylabel("position (µm)")
        return _drawn("ringing", "Ringing", "position over time after small steps", figure)


def _drawn(name: str, title: str, alt: str, figure: Figure) -> ReportFigure:
    return ReportFigure.drawn(name, title, alt, figure)
