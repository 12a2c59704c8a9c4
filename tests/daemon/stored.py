"""Parameters for tests to store, recognised by their sensor zero."""

from datetime import UTC, datetime

from piezod.config.model_file import FitConfig, ModelFile, SourceConfig
from piezod.daemon.stores.parameter_document import AxisParameters

WHEN = datetime(2024, 5, 1, 12, tzinfo=UTC)

MODEL = ModelFile(
    created_at="2024-05-01T12:00:00+00:00",
    created_by="piezod 0.1.0",
    method="least-squares",
    source=SourceConfig(file="µ.csv", sha256="1e3" + "0" * 61),
    fit=FitConfig(voltage_error_max_pct=1.5, voltage_error_rms_pct=1e-7),
    drive_low_v=0,
    drive_high_v=150,
    position_low_um=-0.1,
    position_high_um=26.123456789012345,
    delay_s=1.1e-4,
    right_stop_thresholds=(0.25, 0.5),
    right_stop_weights=(0.1, 1 / 3),
    left_stop_thresholds=(0.25, 0.5),
    left_stop_weights=(0.2, 1e-9),
)


def parameters(zero_um: float) -> dict[str, AxisParameters]:
    """Return the parameters of an axis with a model and of one without."""
    learned = AxisParameters(model=MODEL, zero_um=zero_um, offset=0.01, scale=-0.02)
    return {"x": learned, "y": AxisParameters(model=None, zero_um=-zero_um)}
