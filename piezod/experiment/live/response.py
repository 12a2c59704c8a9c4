"""Measures the frequency response of an axis of a running stage."""

from collections.abc import Sequence
from functools import partial

from piezod.client import StageClient
from piezod.experiment.fit.recorded import on_cycles
from piezod.experiment.live.identify import columns_of
from piezod.experiment.live.setup import read_setup
from piezod.experiment.live.stage import LiveStage
from piezod.experiment.prefix import prefix_errors
from piezod.experiment.progress import Meter, Progress
from piezod.experiment.response.judgement import judged
from piezod.experiment.response.measurement import measured
from piezod.experiment.response.plan import ResponsePlan, Wanted, plan_response
from piezod.records.response_record import AboutVoltage, ResponseRecord


def response_live(
    client: StageClient, axis: str | None, wanted: Wanted, progress: Progress
) -> ResponseRecord:
    """Drive an axis of a running stage about one or several voltages, and fit its response.

    The stage is disarmed at the end in any case.

    Raises:
        ClientError: If a request is refused, or the stage leaves the expected states.
        DataError: If there is no such axis, if the drive is not allowed, or if the record cannot be
            used.
        LatenessError: If the loop was late, also in all repetitions.
    """
    setup = read_setup(client)
    name = setup.measured_axis(axis, "a response")
    config = setup.axes[name].config
    with prefix_errors(f"axis {name}"):
        plans = plan_response(wanted, config.limits, config.safety.ramp_v_per_s, setup.rate_hz)
    meter = Meter(progress, sum(plan.duration_s for plan in plans), f"driving axis {name}")
    with LiveStage(client, setup, meter.advance) as stage:
        about, notes = _driven(stage, name, plans)
        stage.disarm()
    notes = (*notes, *stage.fault_notes())
    title = f"stage {setup.stage} at {setup.rate_hz:g} Hz"
    return judged(name, title, "multisine", setup.rate_hz, about, _remedy(plans), notes)


def _driven(
    stage: LiveStage, axis: str, plans: Sequence[ResponsePlan]
) -> tuple[list[AboutVoltage], tuple[str, ...]]:
    def rearm() -> None:
        stage.disarm()
        stage.arm()

    about, notes = [], dict[str, None]()
    rearm()
    stage.faults.clear()
    for plan in plans:
        found, warnings = stage.until_punctual(partial(_about, stage, axis, plan), rearm)
        about.append(found)
        notes.update(dict.fromkeys(warnings))
    return about, (*stage.notes, *notes)


def _about(stage: LiveStage, axis: str, plan: ResponsePlan) -> tuple[AboutVoltage, tuple[str, ...]]:
    stage.recorder.start(f"response-{axis}")
    stage.drive({axis: plan.drive_v}, plan.duration_s)
    columns, warnings = columns_of(stage.recorder.end(), axis, on_cycles)
    return measured(plan, columns), warnings


def _remedy(plans: Sequence[ResponsePlan]) -> str:
    least = min(plans, key=lambda plan: plan.largest_v)
    return (
        f"raise --amplitude-v, which was {plans[0].amplitude_v:.3g} V and may be up to "
        f"{least.largest_v:.3g} V, or --periods, which was {least.periods}"
    )
