"""Why a movement did not reach its target."""

import pytest

from piezod.client.arrival import too_late
from piezod.messages.telemetry import AxisTelemetry, Range, Telemetry


def interval(
    mode: str, error_um: tuple[float, float], command_um: float = 5.0, faults: tuple[str, ...] = ()
) -> Telemetry:
    """Return the last interval of a movement to 5 µm, with the range of its error and faults."""
    low_um, high_um = error_um
    unknown = Range(min=None, max=None, last=None)
    axis = AxisTelemetry(
        position_um=unknown,
        command_um=Range(min=command_um, max=command_um, last=command_um),
        drive_v=unknown,
        error_um=Range(min=low_um, max=high_um, last=high_um),
        target_um=5.0,
        mode=mode,
    )
    return Telemetry(
        t_s=1.0, cycles=50, lost=0, state="RUN", faults=faults, skipped_cycles=0,
        axes={"x": axis},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("last", "cause"),
    [
        (interval("uncompensated", (1.25, 1.31)), "mode uncompensated leaves the hysteresis"),
        (interval("feedforward", (-0.4, -0.3)), "the model errs by that much, or there is none"),
        (
            interval("feedforward", (-1.6, -1.5), faults=("D10",)),
            "the hysteresis memory is unknown (D10): `piezod stop`, `piezod arm` and",
        ),
        (
            interval("uncompensated", (1.2, 1.3), faults=("D10",)),
            "mode uncompensated leaves the hysteresis",
        ),
        (interval("adaptive", (0.3, 0.4)), "the learned model errs by that much"),
        (interval("trimmed", (0.3, 0.4)), "the trim has not got there yet"),
        (interval("uncompensated", (-0.2, 0.3)), "the error varies between -0.200 and +0.300 µm"),
        (
            interval("uncompensated", (1.2, 1.3), 3.0),
            "the command is at 3.000 µm, still on its way",
        ),
    ],
)
def test_likely_cause_comes_first(last: Telemetry, cause: str) -> None:
    """A command on its way, a steady error of the mode, and noise are told from each other."""
    error = too_late(last, None, 30.0)

    assert f"the stage continues; {cause}" in str(error)
