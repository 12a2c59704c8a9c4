"""An axis of a running stage that plays tables."""

from functools import partial

import numpy as np

from piezod.experiment.live.setup import LiveSetup
from piezod.experiment.live.stage import LiveStage
from piezod.experiment.play.axis import PlayingAxis
from piezod.experiment.play.stage import AtRest, AxisPlayRecord, AxisTable, Identity
from piezod.units import NS_PER_S, s_to_ns

_DECIMALS = 5
"""Digits of a voltage behind the point: 10 µV, so that long tables fit into a request."""


class RunningAxis:
    """Implements `IdentifiedStage` for one axis of a running stage, which is armed and at rest.

    Attributes:
        identity: Identity of the device, known after the first play.
    """

    def __init__(self, stage: LiveStage, name: str, rest_v: float, rest_s: float) -> None:
        self._stage, self._name, self._rest_v, self._rest_s = stage, name, rest_v, rest_s
        self.identity = Identity("", "", "", "")

    def rest(self) -> AtRest:
        """Rest, at the rest voltage."""
        return AtRest(self._stage.pause(self._rest_s), self._rest_v)

    def play(self, table: AxisTable) -> AxisPlayRecord:
        """Play a table, which the daemon checks; return its record."""
        play = partial(
            self._stage.play,
            self._name,
            np.round(table.period_v, _DECIMALS).tolist(),
            np.round(table.lead_in_v, _DECIMALS).tolist(),
            table.interval_ns / NS_PER_S,
            table.cycles,
        )
        rest = partial(self._stage.arm_at_rest, self._rest_s)
        played = self._stage.until_punctual(play, rest)
        self.identity = Identity(**played["device"], firmware="")
        position_um = np.array(played["position_um"], dtype=np.float64)  # null becomes NaN
        interval_ns = s_to_ns(played["record_interval_s"])
        unknown = np.full(position_um.size, np.nan)
        return AxisPlayRecord(interval_ns, position_um, unknown, int(played["first_point"]))


def playing_axis(
    stage: LiveStage, setup: LiveSetup, name: str, interval_ns: int, rest_s: float
) -> PlayingAxis:
    """Return an axis of a running stage, which is armed and at rest, as one that plays.

    Raises:
        ClientError: If a request is refused, or the stage leaves the expected states.
        DataError: If the axis has no model, or does not play.
    """
    config = setup.axes[name].config
    running = RunningAxis(stage, name, config.limits.rest_v, rest_s)
    return PlayingAxis.at_rest(running, name, config, setup.model_of(name), interval_ns)
