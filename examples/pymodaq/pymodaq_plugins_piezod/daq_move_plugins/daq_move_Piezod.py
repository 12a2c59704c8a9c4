"""One axis of a running stage as an actuator of PyMoDAQ."""
# ruff: noqa: N999 - PyMoDAQ needs this form of name

from collections.abc import Iterator
from contextlib import contextmanager

from pymodaq.control_modules.move_utility_classes import (
    DAQ_Move_base,
    DataActuatorType,
    comon_parameters_fun,
)
from pymodaq.utils.data import DataActuator
from pymodaq_utils.utils import ThreadCommand

from piezod.client import AxisStatus, StageClient
from piezod.config.modes import Mode
from piezod.errors import PiezodError


class DAQ_Move_Piezod(DAQ_Move_base):  # noqa: N801 - PyMoDAQ needs this form
    """An axis; several axes of a stage are several actuators, which share the lease.

    The settings name stage and axis, each may be empty if there is only one. The stage moves while
    `armed` is set. A refusal of the daemon is shown in the status line, and the actuator stays.
    """

    _controller_units = "µm"
    _epsilons = 1e9  # `on_target` of the stage decides
    data_actuator_type = DataActuatorType.DataActuator
    params = [  # noqa: RUF012 - PyMoDAQ reads it from the class
        {"title": "Stage:", "name": "stage", "type": "str", "value": ""},
        {"title": "Axis:", "name": "stage_axis", "type": "str", "value": ""},
        {
            "title": "Mode:",
            "name": "mode",
            "type": "list",
            "limits": [mode.value for mode in Mode],
            "value": Mode.TRIMMED.value,
        },
        {"title": "Armed:", "name": "armed", "type": "bool", "value": False},
        *comon_parameters_fun(),
    ]

    def ini_attributes(self) -> None:
        """Begin without a connection."""
        self.controller: StageClient | None = None
        self._axis = ""
        self._motion: int | None = None
        """Number of the movement that goes on; None if there is none."""

    def ini_stage(self, controller: object = None) -> tuple[str, bool]:  # noqa: ARG002 - no use
        """Connect, and take over the limits of the axis."""
        self.controller = stage = StageClient(self.settings["stage"] or None, name="pymodaq")
        status = stage.status()
        self._axis = self.settings["stage_axis"] or next(iter(status.axes))
        config = stage.config()
        axes = {**config["axes"], **config.get("user_axes", {})}
        low, high = axes[self._axis]["command_range_um"]
        self.axis_unit = status.axes[self._axis].unit
        for name, value in (("is_bounds", True), ("min_bound", low), ("max_bound", high)):
            self.settings.child("bounds", name).setValue(value)
        return f"stage {status.stage}, axis {self._axis}: {status.state}", True

    def commit_settings(self, param: object) -> None:
        """Arm the stage in the chosen mode, or ramp it down and disarm it."""
        if param.name() == "armed":
            with self._commanded() as stage:
                if param.value():
                    stage.arm()
                    stage.mode(self.settings["mode"], axis=self._axis)
                else:
                    stage.stop()

    def get_actuator_value(self) -> DataActuator:
        """Return the measured position; without a sensor, the command."""
        axis = self._status()
        position_um = axis.command_um if axis.position_um is None else axis.position_um
        value = DataActuator(data=float(position_um or 0.0), units=self.axis_unit)
        return self.get_position_with_scaling(value)

    def move_abs(self, value: DataActuator) -> None:
        """Move to a position."""
        self.target_value = value = self.check_bound(value)
        position_um = self.set_position_with_scaling(value).value(self.axis_unit)
        with self._commanded() as stage:
            self._motion = stage.goto(position_um, axis=self._axis).motion

    def move_rel(self, value: DataActuator) -> None:
        """Move by a distance."""
        self.move_abs(self.current_value + value)

    def move_home(self, value: object = None) -> None:  # noqa: ARG002 - no use
        """Do nothing: a stage needs no reference."""
        self.move_done()

    def user_condition_to_reach_target(self) -> bool:
        """Return whether the stage reports the axis on the target of the last movement."""
        axis = self._status()
        return self._motion is None or (axis.motion == self._motion and bool(axis.on_target))

    def stop_motion(self) -> None:
        """Hold the stage, and let it go on at its present position."""
        with self._commanded() as stage:
            stage.hold()
            self._motion = None
            stage.resume()
        self.move_done()

    def close(self) -> None:
        """Release the lease; the stage goes on with what it was told last."""
        if self.controller is not None:
            self.controller.release_lease()
            self.controller.close()
            self.controller = None

    def _status(self) -> AxisStatus:
        return self._connected().status().axes[self._axis]

    def _connected(self) -> StageClient:
        if self.controller is None:
            raise PiezodError("the actuator is not initialised")
        return self.controller

    @contextmanager
    def _commanded(self) -> Iterator[StageClient]:
        """Give the client; show a refusal before PyMoDAQ logs it."""
        try:
            yield self._connected()
        except PiezodError as error:
            self.emit_status(ThreadCommand("update_status", str(error)))
            raise
