"""Recordings of a simulated stage in virtual time, like those of a daemon."""

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezod.config.daemon import StageAxisConfig
from piezod.config.model_file import dump_model, load_model
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms.shapes import Sine
from piezod.control.watch.loop import CycleTiming
from piezod.daemon import accepted_config
from piezod.messages import requests
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.writer import TelemetryWriter
from piezod.telemetry.arrays import record_dtype
from piezod.telemetry.descriptions import descriptions, mask_bits
from piezod.telemetry.encoder import encode_axis, encode_cycle
from piezod.telemetry.layout import body_format, enumerations
from piezod.telemetry.record import CycleHeader, CycleRecord
from tests.control.rig_stage import RigStage, shipped_config

RATE_HZ = 500.0
LATE = CycleTiming(0, 1, 10_000, 0, 0)
"""The timing of a cycle before which the loop skipped one."""


def new_stage(axis: StageAxisConfig | None = None, variant: str = "stack") -> RigStage:
    """Return the shipped stage with a slower loop, in SAFE."""
    config = shipped_config()
    rig = config.devices["rig"]
    options = rig.options.model_copy(update={"variant": variant})
    changed = {
        "rate_hz": RATE_HZ,
        "axes": {"x": axis or config.axes["x"]},
        "devices": {"rig": rig.model_copy(update={"options": options})},
    }
    stage = RigStage(config.model_copy(update=changed))
    stage.until(State.SAFE)
    return stage


def sine(low_um: float, high_um: float, frequency_hz: float, duration_s: float) -> requests.Wave:
    """Return the request of a sine on axis x."""
    wave = Sine(kind="sine", low=low_um, high=high_um, frequency_hz=frequency_hz)
    return requests.Wave(command_um={"x": wave}, duration_s=duration_s)


def run_modes(stage: RigStage, modes: Sequence[Mode]) -> None:
    """Arm, follow the same sine for 1.5 s in each mode, and stop; one period is skipped."""
    stage.do(requests.Arm())
    for mode in modes:
        stage.do(requests.SelectMode(mode=mode), sine(2.0, 22.0, 2.0, 1.5))
        stage.run(1.0)
        stage.cycle(LATE)
        stage.run(0.9)
    stage.do(requests.Stop())
    stage.until(State.SAFE)


def write_recording(path: Path, stage: RigStage, weights: Sequence[float] = ()) -> None:
    """Write all cycles of a stage as a daemon records them.

    No weights of axis x are recorded by default.
    """
    config = stage.config
    model = config.axes["x"].model
    assert model is not None
    header = TelemetryHeader(
        title="recorded",
        axes=tuple(config.axes),
        rate_hz=config.rate_hz,
        started_at="2024-05-01T12:00:00+00:00",
        start_ns=stage.records[0].t_ns,
        names={name: [str(m.value) for m in members] for name, members in enumerations().items()},
        notes={
            "configuration": json.dumps(accepted_config.document(config)),
            "model_x": dump_model(load_model(model)),
        },
        weights={"x": len(weights)} if len(weights) else {},
        surfaces=("x",) if load_model(model).is_surface else (),
        descriptions=descriptions(),
        bits=mask_bits(),
    )
    records = encoded(stage.records, stage.period_ns)
    with TelemetryWriter(path, header, records.dtype) as writer:
        if len(weights):
            writer.append_weights("x", header.start_ns, weights, surface="x" in header.surfaces)
        writer.append(records)


def encoded(records: Sequence[CycleRecord], period_ns: int) -> NDArray[Any]:
    """Return the records of cycles without lateness, as they are in the ring."""
    axes = len(records[0].axes)
    body = struct.Struct(body_format(axes))
    buffer = b"".join(
        struct.pack("<q", seq)
        + body.pack(*_values(record, (record.t_ns - records[0].t_ns) // period_ns - seq + 1))
        + struct.pack("<q", seq)
        for seq, record in enumerate(records, 1)
    )
    return np.frombuffer(buffer, record_dtype(axes))


def _values(record: CycleRecord, skipped: int) -> list[float]:
    low = (1 << 64) - 1
    header = CycleHeader(
        t_ns=record.t_ns,
        late_ns=0,
        read_ns=1000,
        compute_ns=2000,
        write_late_ns=3000,
        write_ns=1000,
        skipped=skipped,
        present_lo=record.present & low,
        present_hi=record.present >> 64,
        latched_lo=record.latched & low,
        latched_hi=record.latched >> 64,
        lines=record.lines,
        state=record.state,
        shadow=record.shadow,
        written=record.written,
    )
    return [*encode_cycle(header), *(value for axis in record.axes for value in encode_axis(axis))]
