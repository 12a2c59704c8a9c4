"""Coordinates of a stage: matrices between its sensors, user axes and actuators, and its paths.

Pure linear algebra of a few numbers, without numpy: every configuration is checked with it, and the
cycle uses it. It knows nothing of volts and of time.
"""
