"""A running stage as a motor of qudi."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from qudi.core.configoption import ConfigOption
from qudi.interface.motor_interface import MotorInterface

from piezod.client import StageClient
from piezod.errors import PiezodError

M_PER_UM: Final = 1e-6
UNITS: Final = {"µm": "m", "µrad": "rad"}
DONE, FAILED = 0, -1
RESTS, MOVES = 0, 1


class PiezodStage(MotorInterface):
    """All axes of a stage that take commands; positions are in m or rad, as everywhere in qudi.

    The stage is armed while the module is active. A command that the daemon refuses returns -1, and
    the log has the reason.

    Example of its configuration:

        piezo_stage:
            module.Class: 'piezod.piezod_stage.PiezodStage'
            options:
                stage: 'simulated'
                mode: 'trimmed'
    """

    _stage = ConfigOption(name="stage", default=None)
    _mode = ConfigOption(name="mode", default="trimmed")

    def on_activate(self) -> None:
        """Connect, and arm the stage."""
        self._client = StageClient(self._stage, name="qudi")
        self._motions: dict[str, int] = {}
        config = self._client.config()
        axes = config.get("user_axes") or config["axes"]
        self._units = {name: UNITS[axes[name].get("unit", "µm")] for name in axes}
        self._ranges_um = {name: tuple(axes[name]["command_range_um"]) for name in axes}
        self._client.arm()
        for axis in axes:
            self._client.mode(self._mode, axis=axis)

    def on_deactivate(self) -> None:
        """Ramp the stage down, and disconnect."""
        with self._client as client:
            client.stop()
            client.release_lease()

    def get_constraints(self) -> dict[str, dict[str, Any]]:
        """Return the range of each axis; its speed is that of the stage."""
        unknown = dict.fromkeys(
            ("ramp", "pos_step", "vel_min", "vel_max", "vel_step", "acc_min", "acc_max", "acc_step")
        )
        return {
            axis: {
                "label": axis, "unit": self._units[axis], **unknown,
                "pos_min": low * M_PER_UM, "pos_max": high * M_PER_UM,
            }
            for axis, (low, high) in self._ranges_um.items()
        }  # fmt: skip

    def move_abs(self, param_dict: Mapping[str, float]) -> int:
        """Move axes to positions; return before they have arrived."""
        try:
            for axis, position_m in param_dict.items():
                moving = self._client.goto(position_m / M_PER_UM, axis=axis)
                self._motions[axis] = moving.motion
        except PiezodError as error:
            return self._failed(error)
        return DONE

    def move_rel(self, param_dict: Mapping[str, float]) -> int:
        """Move axes by distances from where they are."""
        here_m = self.get_pos(param_dict)
        return self.move_abs({axis: here_m[axis] + way for axis, way in param_dict.items()})

    def abort(self) -> int:
        """Hold all axes where they are, and let them go on from there."""
        try:
            self._client.hold()
            self._client.resume()
        except PiezodError as error:
            return self._failed(error)
        self._motions.clear()
        return DONE

    def get_pos(self, param_list: Iterable[str] | None = None) -> dict[str, float]:
        """Return measured positions; without a sensor, the commands."""
        axes = self._client.status().axes
        found = {}
        for name in param_list or axes:
            axis = axes[name]
            um = axis.command_um if axis.position_um is None else axis.position_um
            found[name] = (um or 0.0) * M_PER_UM
        return found

    def get_status(self, param_list: Iterable[str] | None = None) -> dict[str, int]:
        """Return 1 for each axis that has not arrived yet, else 0."""
        axes = self._client.status().axes
        return {name: self._state(name, axes[name]) for name in param_list or axes}

    def _state(self, name: str, axis: Any) -> int:
        if name not in self._motions:
            return RESTS
        return RESTS if axis.motion == self._motions[name] and axis.on_target else MOVES

    def _failed(self, error: PiezodError) -> int:
        self.log.error(f"refused: {error}")
        return FAILED

    def calibrate(self, param_list: Iterable[str] | None = None) -> int:  # noqa: ARG002 - no use
        """Do nothing: a stage needs no reference."""
        return DONE

    def get_velocity(self, param_list: Iterable[str] | None = None) -> dict[str, None]:
        """Return None for each axis: the configuration of the stage has its speed."""
        return dict.fromkeys(param_list or self._ranges_um)

    def set_velocity(self, param_dict: Mapping[str, float]) -> int:  # noqa: ARG002 - no use
        """Refuse: the configuration of the stage has its speed."""
        self.log.error("the speed is set in the configuration of the stage")
        return FAILED
