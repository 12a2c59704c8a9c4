"""The document of `piezod identify --json`."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from piezod.experiment.fit.automatic import Candidate, Choice
from piezod.experiment.fit.delay import DelayEstimate
from piezod.experiment.fit.errors import CrossValidation, Judgement
from piezod.experiment.fit.excitation import recommended_drive
from piezod.experiment.fit.file import FileFit
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.uncertainty import Uncertainty
from piezod.experiment.fit.verdict import verdict_of
from piezod.hysteresis.memory import FloatArray

Document = dict[str, object]


def as_document(fitted: FileFit, model: Path | None, plot: Path | None) -> Document:
    """Return the document of `piezod identify --json`."""
    fit, record = fitted.chosen.fit, fitted.record
    by_creep = {each.fit.settings.creep: each for each in (fitted.chosen, fitted.other) if each}
    return {
        "data": str(fitted.data),
        "test_data": str(fitted.test_data) if fitted.test_data else None,
        "read_as": fitted.understood,
        "samples": fitted.recorded.t_s.size,
        "rate_hz": 1.0 / fitted.recorded.period_s,
        "fitted_samples": record.t_s.size,
        "fitted_rate_hz": 1.0 / record.period_s,
        "not_counted_s": record.run_in_s,
        **_settings(fit),
        "delay_s": fit.model.delay_s,
        "delay_estimate": _delay(fit.delay) if fit.delay else None,
        "first_mode": _first_mode(fitted),
        "smallest_slope": fit.smallest_slope,
        **_errors(fitted.chosen),
        "with_creep": _errors(by_creep[True]) if True in by_creep else None,
        "without_creep": _errors(by_creep[False]) if False in by_creep else None,
        "raw_displacement": _errors(fitted.raw) if fitted.raw else None,
        "position_residual": asdict(fitted.parts),
        "uncertainty": _uncertainty(fitted.uncertainty),
        "choice": _choice(fitted.choice) if fitted.choice else None,
        "excitation": {
            "missing": fitted.missing_excitation,
            "recommended": recommended_drive(*fit.model.drive_v),
        },
        "verdict": verdict_of(fitted, written=model is not None)._asdict(),
        "misfits": fitted.misfits,
        "questions": fitted.questions,
        "warnings": fitted.warnings,
        "model": str(model) if model else None,
        "plot": str(plot) if plot else None,
    }


def _settings(fit: Fit) -> Document:
    settings = fit.settings
    operators = settings.method is not Method.SURFACE
    return {
        "method": settings.method,
        "order": settings.order if operators else None,
        "thresholds": settings.spacing if operators else None,
        "creep": settings.creep,
        "creep_per_decade": fit.model.creep.per_decade,
        "rate_lag": fit.rate_lag,
        "path_relaxation": asdict(fit.path) if fit.path else None,
    }


def _first_mode(fitted: FileFit) -> Document | None:
    fit, half, configured = fitted.chosen.fit, fitted.uncertainty.mode, fitted.configured_mode
    if fit.model.mode is None or fit.shows_mode is None or half is None:
        return None
    return {
        **fit.model.mode._asdict(),
        **{f"{name}_95": value for name, value in half._asdict().items()},
        "held_out_position_error_rms_pct": fit.shows_mode.with_pct,
        "held_out_position_error_rms_without_mode_pct": fit.shows_mode.without_pct,
        "configured": configured.model_dump() if configured else None,
    }


def _errors(judged: Judgement) -> Document:
    offset = judged.test_offset_removed
    return {
        "train": judged.train,
        "cross_validation": _cross_validation(judged.validation),
        "test": judged.test,
        "test_offset_removed": {
            **offset.errors,
            "offset_pct": offset.offset_pct,
            "offset_um": offset.offset_um,
            "position_offset_um": offset.position_offset_um,
        }
        if offset
        else None,
    }


def _cross_validation(validation: CrossValidation) -> Document:
    return {
        **validation.errors,
        "position_error_rms_worst_block_pct": validation.worst_block_rms_pct,
        "voltage_error_rms_with_standard_error_pct": validation.rms_with_standard_error_pct,
        "blocks": [
            {"start_s": block.start_s, "end_s": block.end_s, **block.errors}
            for block in validation.blocks
        ],
    }


def _uncertainty(uncertainty: Uncertainty) -> Document:
    return {
        "delay_95_s": uncertainty.delay_s,
        "creep_per_decade_95": uncertainty.creep_per_decade,
        "voltage_band_95": spread(uncertainty.band_pct),
        "independent_samples": uncertainty.independent_samples,
        "voltage_spread_over_blocks": spread(uncertainty.spread_pct),
        "creep_per_decade_of_blocks": uncertainty.block_creep_per_decade,
        "delay_of_blocks_s": uncertainty.block_delay_s,
    }


def spread(values_pct: FloatArray | None) -> dict[str, float] | None:
    """Return the largest value and the rms, by name; None without values."""
    if values_pct is None:
        return None
    return {
        "max_pct": float(np.max(values_pct)),
        "rms_pct": float(np.sqrt(np.mean(values_pct**2))),
    }


def _choice(choice: Choice) -> Document:
    return {
        "limit_rms_pct": choice.limit_pct,
        "candidates": [_candidate(each, choice) for each in choice.candidates],
    }


def _candidate(candidate: Candidate, choice: Choice) -> Document:
    return {
        **_settings(candidate.fit),
        "parameters": candidate.n_parameters,
        **candidate.validation.errors,
        "best": candidate is choice.best,
        "taken": candidate is choice.chosen,
    }


def _delay(delay: DelayEstimate) -> Document:
    return {
        "delay_s": delay.delay_s,
        "uncertainty_s": delay.uncertainty_s,
        "one_frequency": delay.one_frequency,
        "criterion": {
            "delay_s": delay.candidates_s.tolist(),
            f"{'position' if delay.of_position else 'voltage'}_error_rms_pct": (
                delay.criterion_pct.tolist()
            ),
        },
    }
