"""Dynamics of a stage: its frequency response as a model, and what follows from it.

A stage is hysteresis followed by linear dynamics: the hysteresis makes a displacement of the drive,
and the dynamics, with a static gain of one, delay and filter it. Mathematics only: no volts, no
clocks, no files.
"""

from piezod.dynamics.model import Resonance, ResponseModel

__all__ = ["Resonance", "ResponseModel"]
