"""The player of one axis: tables in V, and records in µm, by the calibrations of its channels."""

from math import isnan, nan

import numpy as np

from piezod.devices.inputs import CalibratedInput
from piezod.devices.interface import Sample, Wiring
from piezod.devices.outputs import CalibratedOutput
from piezod.devices.player import FloatArray, PlayedRecord, Player, Progress, Table
from piezod.devices.wiring import ChannelPair


class AxisPlayer:
    """Plays tables of one axis, in V, on a device that serves this axis alone.

    Args:
        player: The device, open and active.
        axis: Name of the axis.
        pair: Its channels, both on this device.
        wiring: All channels of the device.
        output: Its calibrated output.
    """

    def __init__(
        self,
        player: Player,
        axis: str,
        pair: ChannelPair,
        wiring: Wiring,
        output: CalibratedOutput,
    ) -> None:
        self._player, self._output = player, output
        self._input = CalibratedInput(wiring, pair.input or axis, pair.to_um, pair.light)
        self.capabilities = player.player_capabilities()
        """Capabilities of the player."""

    def load(self, table: Table) -> Table:
        """Load a table of one output, in V; return it in V as the device will play it.

        Raises:
            DeviceError: If the device refuses it.
        """
        taken = self._player.load(
            table._replace(lead_in=self._values(table.lead_in), period=self._values(table.period))
        )
        return taken._replace(
            lead_in=self._voltages(taken.lead_in), period=self._voltages(taken.period)
        )

    def start(self, now_ns: int) -> None:
        """Arm and start the loaded table.

        Raises:
            DeviceError: If the device refuses.
        """
        self._player.arm()
        self._player.start(now_ns)

    def progress(self, now_ns: int) -> Progress:
        """Return the progress."""
        return self._player.progress(now_ns)

    def abort(self, now_ns: int) -> float:
        """Stop the play; return the voltage in force, in V, NaN if it is unknown."""
        return self._output.voltage(self._player.abort(now_ns)[0])

    def recording(self) -> PlayedRecord:
        """Return the record of the play, in µm, shape (k, 1); NaN for samples that are not valid.

        Raises:
            DeviceError: If it could not be read.
        """
        raw = self._player.recording()
        position_um = [self._position_um(each) for each in raw.positions.tolist()]
        return raw._replace(positions=np.array(position_um)[:, np.newaxis])

    def _position_um(self, values: list[float]) -> float:
        sample = self._input.sample([Sample(0, value, not isnan(value)) for value in values])
        return sample.position_um if sample.valid else nan

    def _values(self, table_v: FloatArray) -> FloatArray:
        return np.array([[self._output.value(v)] for (v,) in table_v.tolist()]).reshape(-1, 1)

    def _voltages(self, table: FloatArray) -> FloatArray:
        return np.array([[self._output.voltage(v)] for (v,) in table.tolist()]).reshape(-1, 1)
