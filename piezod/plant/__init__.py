"""The physics of a simulated stage, its amplifier and its sensor.

Knows nothing of control and of the models that compensate it; drivers and emulators use it.
"""
