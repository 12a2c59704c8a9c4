"""Physics of a simulated stage, its amplifier and its sensor.

The package knows neither control nor the models that compensate the stage. Drivers and emulators
use it.
"""
