"""An axis of a running stage as a stage of pymmcore-plus, for example the focus of its core."""

from pymmcore_plus.experimental.unicore import StageDevice

from piezod.client import StageClient


class PiezodStage(StageDevice):
    """One axis; the stage is armed from `initializeDevice` until the device is unloaded.

    Args:
        axis: Name of the axis.
        stage: Name of the stage; None for the only one that runs.
        mode: Mode of the axis.
    """

    def __init__(self, axis: str, stage: str | None = None, mode: str = "trimmed") -> None:
        super().__init__()
        self._axis, self._stage, self._mode = axis, stage, mode
        self._client: StageClient | None = None

    def initialize(self) -> None:
        """Connect, and arm the stage."""
        client = StageClient(self._stage, name="pymmcore")
        if (unit := client.status().axes[self._axis].unit) != "µm":
            client.close()
            raise ValueError(
                f"axis {self._axis} is in {unit}: positions of a StageDevice are in µm"
            )
        client.arm()
        client.mode(self._mode, axis=self._axis)
        self._client = client

    def shutdown(self) -> None:
        """Ramp the stage down, and disconnect."""
        client, self._client = self._client, None
        if client is not None:
            with client:
                client.stop()
                client.release_lease()

    def set_position_um(self, val: float) -> None:
        """Move; return when the axis is on target, so that an exposure may begin."""
        self._connected.goto_and_wait(val, axis=self._axis)

    def get_position_um(self) -> float:
        """Return the measured position; without a sensor, the command."""
        axis = self._connected.status().axes[self._axis]
        um = axis.command_um if axis.position_um is None else axis.position_um
        return um or 0.0

    def stop(self) -> None:
        """Hold where the stage is, and let it go on from there."""
        self._connected.hold()
        self._connected.resume()

    def home(self) -> None:
        """Refuse: a stage needs no reference."""
        raise NotImplementedError("positions are absolute: a stage of piezod has no home")

    def set_origin(self) -> None:
        """Refuse: the daemon keeps the zero."""
        raise NotImplementedError("`piezod zero` zeroes the sensor of a stage at rest")

    @property
    def _connected(self) -> StageClient:
        if self._client is None:
            raise RuntimeError("not connected: initialize the device first")
        return self._client
