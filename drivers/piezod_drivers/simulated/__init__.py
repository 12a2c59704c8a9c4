"""A simulated stage with amplifier and sensor, as a driver like any other.

`calibration.py` turns the sensor's voltage into a displacement. The physics is in `piezod.plant`.
"""
