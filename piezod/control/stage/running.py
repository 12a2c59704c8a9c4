"""From READY to RUN, with the first movement."""

from piezod.config.modes import SENSED, Mode
from piezod.control.stage.stage import Stage
from piezod.control.stage.states import Event


def start_running(stage: Stage, t_ns: int) -> str:
    """Go from READY to RUN in the selected modes; return why not, empty if done."""
    # One axis that needs the sensor is enough for the stricter edge.
    sensed = [axis.mode for axis in stage.axes if axis.mode in SENSED]
    return stage.go(run_event(sensed[0] if sensed else Mode.FEEDFORWARD), t_ns)


def run_event(mode: Mode) -> Event:
    """Return the edge to RUN in a mode."""
    return Event.RUN_ADAPTIVE if mode in SENSED else Event.RUN
