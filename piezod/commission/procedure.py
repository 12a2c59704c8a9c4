"""The steps of commissioning in their order: each is announced, confirmed, done and undone."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from math import isfinite
from typing import Final, NamedTuple, TypeVar

from piezod.commission.noise import DURATION_S, Noise, measure_noise
from piezod.commission.polarity import REPEATS, Polarity, find_polarity, step_v
from piezod.commission.response import Response, measure_delay
from piezod.commission.ringing import Ringing, find_ringing
from piezod.commission.session import Session
from piezod.commission.session_trace import SessionTrace
from piezod.commission.travel import (
    STAGES_PCT,
    Travel,
    TravelAmplifier,
    amplifier_of,
    excursion,
    farther_end_v,
    travel_of,
)
from piezod.errors import DataError, DeviceError
from piezod.experiment.lateness import until_punctual

BIAS_STEPS: Final = 5
"""Bias for delay and resonance, relative to the initial voltage, in steps of the polarity step."""
SWING_STEPS: Final = 2
"""Size of the sines and steps for delay and resonance, in the same unit."""
BIAS_REST_S: Final = 0.5
"""Rest at the bias, in s, after which most of the creep is over."""

T = TypeVar("T")


@dataclass
class Findings:
    """Results so far; None for a step that was not done or had no result."""

    noise: Noise | None = None
    polarity: Polarity | None = None
    travel: Travel | None = None
    amplifier: TravelAmplifier | None = None
    response: Response | None = None
    ringing: Ringing | None = None
    traces: dict[str, SessionTrace] = field(default_factory=dict)


class ProcedureStep(NamedTuple):
    """One step."""

    name: str  #: Its name.
    what: str  #: Announcement with every voltage, for the person who confirms it.
    moves: bool  #: Whether the stage moves.
    #: Does the step and stores its result; returns the result as a line of text.
    run: Callable[[], str]


def steps_of(
    session: Session, findings: Findings, note: Callable[[str], object] = str
) -> Iterator[ProcedureStep]:
    """Yield the steps one after the other; they drive exactly the announced voltages.

    A step is repeated while the computer was late; `run` raises LatenessError if it stays late.

    Args:
        session: The axis.
        findings: Receives the results.
        note: Called with the reason before a step is repeated.
    """
    for step in _steps(session, findings):
        yield step._replace(run=partial(_punctual, session, step.run, note))


def _punctual(session: Session, run: Callable[[], str], note: Callable[[str], object]) -> str:
    def again(reason: str) -> None:
        note(reason)
        session.back()

    session.take_lateness()  # that of the time before the step does not count
    return until_punctual(run, session.take_lateness, again, DeviceError, DataError)


def _steps(session: Session, findings: Findings) -> Iterator[ProcedureStep]:
    # Computed once, before the first step: what is announced must be what is driven.
    size_v, way_v = step_v(session), farther_end_v(session) - session.found_v
    yield _noise(session, findings)
    yield _polarity(session, findings, size_v)
    # In growing parts: the person can stop before the stage reaches an obstacle.
    for part_pct in STAGES_PCT:
        end_v = session.found_v + part_pct / 100.0 * way_v
        yield _excursion(session, findings, f"travel {part_pct} %", end_v)
    bias_v, swing_v = session.found_v + BIAS_STEPS * size_v, SWING_STEPS * size_v
    yield _delay(session, findings, bias_v, swing_v)
    yield _ringing(session, findings, bias_v, swing_v)


def _noise(session: Session, findings: Findings) -> ProcedureStep:
    def run() -> str:
        findings.noise, findings.traces["noise"] = found, _ = measure_noise(session)
        return (
            f"noise {found.rms_um * 1e3:.1f} nm rms, drift {found.drift_um_per_s * 1e3:+.1f} nm/s, "
            f"{found.valid_pct:.0f} % of the samples valid"
        )

    what = f"hold {session.drive_v:z.2f} V for {DURATION_S:g} s and record the sensor"
    return ProcedureStep("noise", what, False, run)


def _polarity(session: Session, findings: Findings, size_v: float) -> ProcedureStep:
    def run() -> str:
        found, trace = find_polarity(session, size_v, _rms_um(findings))
        findings.polarity, findings.traces["polarity"] = found, trace
        session.back()
        way = "rises" if found.um_per_v > 0 else "FALLS"
        return (
            f"the position {way} with the voltage: {found.um_per_v * 1e3:+.1f} ± "
            f"{found.uncertainty_um_per_v * 1e3:.1f} nm/V"
        )

    what = f"{REPEATS} times {size_v:+.2f} V from {session.drive_v:z.2f} V, slowly, and back"
    return ProcedureStep("polarity", what, True, run)


def _excursion(session: Session, findings: Findings, name: str, end_v: float) -> ProcedureStep:
    def run() -> str:
        trace = excursion(session, end_v)
        # Each stage replaces the result of the smaller one before.
        findings.travel = found = travel_of(trace, _rms_um(findings))
        findings.amplifier, findings.traces["travel"] = amplifier_of(trace), trace
        return (
            f"{found.travel_um:+.3f} µm to {end_v:.1f} V, {found.um_per_v * 1e3:.1f} nm/V, "
            f"loop {found.loop_pct:.1f} % wide"
        )

    what = f"ramp from {session.found_v:z.2f} V to {end_v:.1f} V and back"
    return ProcedureStep(name, what, True, run)


def _delay(session: Session, findings: Findings, bias_v: float, size_v: float) -> ProcedureStep:
    def run() -> str:
        findings.response, findings.traces["delay"] = found, _ = _at(
            session, bias_v, lambda: measure_delay(session, size_v)
        )
        if not found.found:
            return "these sines give no delay; try a higher rate_hz"
        return f"delay {found.delay_s * 1e3:.3f} ± {found.uncertainty_s * 1e3:.3f} ms"

    what = f"ramp to {bias_v:.1f} V, sines of {size_v:+.1f} V from there, and back"
    return ProcedureStep("delay", what, True, run)


def _ringing(session: Session, findings: Findings, bias_v: float, size_v: float) -> ProcedureStep:
    def run() -> str:
        findings.ringing, findings.traces["ringing"] = found, _ = _at(
            session, bias_v, lambda: find_ringing(session, size_v)
        )
        if not found.found:
            return f"no resonance found at {session.rate_hz:g} Hz; try a higher rate_hz"
        return f"first mode at {found.frequency_hz:.0f} Hz, damping {found.damping:.3f}"

    what = f"ramp to {bias_v:.1f} V, steps of {size_v:+.1f} V from there, and back"
    return ProcedureStep("ringing", what, True, run)


def _at(session: Session, bias_v: float, measure: Callable[[], T]) -> T:
    """Return a measurement at a bias voltage; afterwards the axis is back."""
    session.go(bias_v)
    session.rest(BIAS_REST_S)
    found = measure()
    session.back()
    return found


def _rms_um(findings: Findings) -> float:
    noise = findings.noise
    return noise.rms_um if noise is not None and isfinite(noise.rms_um) else 0.0
