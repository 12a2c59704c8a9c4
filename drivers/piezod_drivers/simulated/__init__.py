"""A simulated stage with amplifier and sensor, as a driver like any other.

`axis.py` is one axis with its physics, which is in `piezod.plant`; `calibration.py` turns the
sensor's voltage into a displacement; `coupling.py` moves axes with each other; `player.py` plays
tables; `pattern.py` lies under the detector of scans; `camera.py` pulses the trigger input;
`lines.py` has digital lines.
"""
