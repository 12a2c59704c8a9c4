"""Output of a measurement: the response file, the table of its lines, and the figure."""

import hashlib
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

import piezod
from piezod.config.model_file import SourceConfig
from piezod.config.response_file import (
    GainConfig,
    ResonanceConfig,
    ResponseFile,
    dump_response,
)
from piezod.errors import ModelError
from piezod.hysteresis.memory import FloatArray
from piezod.records.atomic import replacing
from piezod.records.csv_file import write_csv
from piezod.records.figures import save_png
from piezod.records.figures.response import response_figure
from piezod.records.response_record import ResponseRecord


class Written(NamedTuple):
    """Paths of the written files: response, table, figure."""

    response: Path
    table: Path
    figure: Path


def write_response(path: Path, record: ResponseRecord, created_at: datetime) -> Written:
    """Write the response file, and beside it the table of the lines and the figure.

    Args:
        path: The response file; the others have its name with the suffixes .csv and .png.
        record: The measurement.
        created_at: Time of the measurement, with a time zone.

    Raises:
        ModelError: If a number exceeds the range of a response file.
        OSError: If a file cannot be written.
    """
    written = Written(path, path.with_suffix(".csv"), path.with_suffix(".png"))
    write_csv(written.table, table_of(record))
    digest = hashlib.sha256(written.table.read_bytes()).hexdigest()
    source = SourceConfig(file=written.table.name, sha256=digest)
    text = dump_response(to_response_file(record, created_at, source))
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    save_png(written.figure, response_figure(record))
    return written


def to_response_file(
    record: ResponseRecord, created_at: datetime, source: SourceConfig | None
) -> ResponseFile:
    """Return the contents of a response file, with exact numbers.

    Raises:
        ModelError: If a number exceeds the range of a response file.
    """
    fit = record.fit
    coherence = np.concatenate([each.coherence for each in fit.used])
    try:
        return ResponseFile(
            created_at=created_at.isoformat(timespec="seconds"),
            created_by=f"piezod {piezod.__version__}",
            method=record.method,
            source=source,
            rate_hz=record.rate_hz,
            low_hz=fit.low_hz,
            high_hz=fit.high_hz,
            coherence_low=float(coherence.min()),
            coherence_high=float(coherence.max()),
            gains=tuple(
                GainConfig(
                    offset_v=about.offset_v,
                    amplitude_v=about.amplitude_v,
                    um_per_v=gain,
                    uncertainty_um_per_v=uncertain,
                )
                for about, (gain, uncertain) in zip(record.about, fit.gains, strict=True)
            ),
            delay_s=fit.model.delay_s,
            delay_uncertainty_s=fit.delay_uncertainty_s,
            resonances=tuple(
                ResonanceConfig(
                    frequency_hz=mode.frequency_hz,
                    damping=mode.damping,
                    share=mode.share,
                    frequency_uncertainty_hz=uncertain[0],
                    damping_uncertainty=uncertain[1],
                    share_uncertainty=uncertain[2],
                )
                for mode, uncertain in zip(fit.model.resonances, fit.uncertainties, strict=True)
            ),
        )
    except ValueError as error:
        raise ModelError(f"the response cannot be written: {error}") from error


def table_of(record: ResponseRecord) -> dict[str, FloatArray]:
    """Return the columns of the table: one row for each line and voltage."""
    rows = []
    for index, about in enumerate(record.about):
        lines, f = about.response, about.response.frequency_hz
        model = record.fit.fitted(index, f)
        used = np.isin(f, record.fit.used[index].frequency_hz)
        rows.append(
            {
                "offset_v": np.full(f.size, about.offset_v),
                "frequency_hz": f,
                "gain_um_per_v": np.abs(lines.response),
                "phase_deg": np.degrees(np.angle(lines.response)),
                "uncertainty_um_per_v": np.sqrt(lines.variance),
                "coherence": lines.coherence,
                "model_gain_um_per_v": np.abs(model),
                "model_phase_deg": np.degrees(np.angle(model)),
                "used": used.astype(np.float64),
            }
        )
    return {name: np.concatenate([each[name] for each in rows]) for name in rows[0]}
