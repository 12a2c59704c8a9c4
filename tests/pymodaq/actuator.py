"""PyMoDAQ with the example plug-in, without a screen: python actuator.py; prints JSON.

It moves the only stage that runs.
"""

import json
from typing import Any, Final

from pymodaq.control_modules.instruments import find_actuator_class_from_name
from pymodaq.utils.data import DataActuator
from qtpy.QtCore import QTimer
from qtpy.QtWidgets import QApplication

from piezod.errors import PiezodError

UNIT: Final = "µm"
LONGEST_MS: Final = 60_000


class Bench:
    """The actuator and the event loop that polls it."""

    def __init__(self) -> None:
        self.app = QApplication([])
        QTimer.singleShot(LONGEST_MS, self.app.quit)
        self.actuator = find_actuator_class_from_name("Piezod")(None, None)
        self.actuator.move_done_signal.connect(lambda _: self.app.quit())

    def set(self, name: str, value: object) -> None:
        """Change a setting, as the user does."""
        parameter = self.actuator.settings.child(name)
        parameter.setValue(value)
        self.actuator.commit_settings(parameter)

    def moved(self, method: str, value_um: float) -> float:
        """Move and poll until PyMoDAQ reports the end; return the position then."""
        getattr(self.actuator, method)(DataActuator(data=value_um, units=UNIT))
        self.actuator.poll_moving()
        self.app.exec()
        return self.position()

    def position(self) -> float:
        """Return the position as PyMoDAQ reads it."""
        return float(self.actuator.get_actuator_value().value(UNIT))


def run() -> dict[str, Any]:
    """Use all commands of the actuator; return what they showed."""
    bench = Bench()
    actuator = bench.actuator
    text, ready = actuator.ini_stage()
    bounds = actuator.settings.child("bounds")
    report: dict[str, Any] = {
        "connected": [text, ready],
        "limits": [bounds["min_bound"], bounds["max_bound"]],
    }
    try:
        bench.moved("move_abs", 5.0)
    except PiezodError as error:
        report["refused"] = str(error)
    bench.set("armed", True)
    report["reached"] = [bench.moved("move_abs", 5.0), bench.moved("move_rel", 2.5)]
    report["beyond"] = bench.moved("move_abs", 99.0)
    actuator.move_abs(DataActuator(data=2.0, units=UNIT))
    actuator.stop_motion()
    report["after stop"] = bench.moved("move_abs", 8.0)
    bench.set("armed", False)
    actuator.close()
    return report


if __name__ == "__main__":
    print(json.dumps(run()))
