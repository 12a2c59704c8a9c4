"""The mathematics of hysteresis: operators, forward and inverse models, identification, metrics.

Knows nothing of volts, time, devices and files: everything here is normalised.
"""
