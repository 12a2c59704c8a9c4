"""A stage that exists only in numbers, as a driver like any other.

Files: `options.py` is what a configuration may say, `calibration.py` turns the sensor's voltage
into a displacement, `driver.py` is the device. The physics is in `piezod.plant`.
"""
