"""An axis that plays, virtual or running: its zero, its tables, and the conditions of these."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from piezod.config.axes import AxisConfig
from piezod.config.response_file import ResponseFile
from piezod.control.law.compensated import limits_of
from piezod.control.law.model import StageModel
from piezod.errors import DataError, PiezodError
from piezod.experiment.play.response import (
    MultisineSettings,
    measure_response,
    stored_response,
    usual_multisine,
)
from piezod.experiment.play.stage import IdentifiedStage
from piezod.experiment.play.stored import Conditions, model_sha256
from piezod.experiment.play.tables import TableMaker
from piezod.experiment.play.task import KnownAxis
from piezod.experiment.play.zeroed import ZeroedAxis

AMPLITUDES = (0.03, 0.015, 0.007, 0.003)
"""Amplitudes of the multisine that measures the response of an axis which has no response file, as
shares of the range."""


@dataclass(frozen=True, eq=False)
class PlayingAxis:
    """An axis that plays tables."""

    stage: ZeroedAxis  #: The axis, relative to its zero.
    interval_ns: int  #: Time between two points of a table, in ns.
    model: StageModel  #: Its model.
    maker: TableMaker  #: Makes tables for it, by its inverse model.
    response: ResponseFile | None  #: Its response from a file; None if it has to be measured.
    conditions: Conditions  #: Conditions of its tables.

    @classmethod
    def at_rest(
        cls,
        stage: IdentifiedStage,
        name: str,
        config: AxisConfig,
        model: StageModel,
        interval_ns: int,
    ) -> Self:
        """Return an axis, zeroed by a play at rest: it drifts between the waveforms.

        Raises:
            PiezodError: If the play failed.
        """
        limits, rest_v = limits_of(config), config.limits.rest_v
        sensor_delay_s = config.compensator.sensor_delay_s
        range_v = limits.drive_min_v, limits.drive_max_v
        if model.rests_inside(rest_v):  # the conditioning ends with a rise from the lowest voltage
            model = model.zeroed_from_below(rest_v)
        maker = TableMaker(model, interval_ns, range_v, limits.slew_v_per_s)
        return cls(
            ZeroedAxis(stage, interval_ns, maker.conditioning(rest_v)),
            interval_ns,
            model,
            maker,
            config.response,
            Conditions(name, stage.identity, model_sha256(model), sensor_delay_s, rest_v),
        )

    def known(self, multisine: MultisineSettings) -> KnownAxis:
        """Return what is known of the axis; a response that no file has is measured.

        Raises:
            PiezodError: If the response could not be measured.
        """
        if self.response is not None:
            response = stored_response(self.response, self.interval_ns)
        else:
            range_um = self.model.position_um
            response = measure_response(self.stage, self.maker, range_um, multisine)
        delay_s = self.conditions.sensor_delay_s
        return KnownAxis(self.maker, self.model.creep, response, delay_s)

    def slowly_known(
        self, refusal: type[PiezodError], check: Callable[[PiezodError], None] = lambda _: None
    ) -> KnownAxis:
        """Return what is known of the axis, measured with the largest amplitude that it accepts.

        Args:
            refusal: What is raised for a table that is too fast for the axis.
            check: Called with each refusal; may raise another error.

        Raises:
            PiezodError: If the response could not be measured.
        """
        for amplitude in AMPLITUDES:
            try:
                return self.known(usual_multisine(self.interval_ns, amplitude))
            except refusal as error:
                check(error)
                last = error
        raise DataError(f"no multisine is slow enough for the axis: {last}")
