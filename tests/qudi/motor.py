"""qudi's motor interface with the example module, without a screen: python motor.py; prints JSON.

It moves the only stage that runs.
"""

import json
import time
from collections.abc import Callable
from typing import Any, Final

from PySide6.QtCore import QCoreApplication
from qudi.hardware.piezod.piezod_stage import PiezodStage

LONGEST_S: Final = 60.0
LOOK_S: Final = 0.05


def until(condition: Callable[[], bool]) -> None:
    """Wait, as qudi's logic does: it polls the status.

    Raises:
        TimeoutError: If the condition stays false.
    """
    end_s = time.monotonic() + LONGEST_S
    while not condition():
        if time.monotonic() > end_s:
            raise TimeoutError
        time.sleep(LOOK_S)


def moved(motor: PiezodStage) -> float:
    """Wait until the axis has arrived; return its position, in µm."""
    until(lambda: motor.get_status(["x"]) == {"x": 0})
    position_m: float = motor.get_pos(["x"])["x"]
    return 1e6 * position_m


def main() -> None:
    """Activate the module, as qudi does, use each function, and deactivate it."""
    application = QCoreApplication([])
    motor = PiezodStage(None, "piezo_stage", {})
    motor.module_state.activate()
    report: dict[str, Any] = {"constraints": motor.get_constraints()["x"]}
    report["absolute"] = motor.move_abs({"x": 5e-6}), moved(motor)
    report["relative"] = motor.move_rel({"x": 2.5e-6}), moved(motor)
    report["beyond"] = motor.move_abs({"x": 1e-3}), moved(motor)
    motor.move_abs({"x": 20e-6})
    report["stopped"] = motor.abort(), motor.get_status()
    report["velocity"] = motor.get_velocity(), motor.set_velocity({"x": 1.0}), motor.calibrate()
    motor.module_state.deactivate()
    application.quit()
    print(json.dumps(report))


if __name__ == "__main__":
    main()
