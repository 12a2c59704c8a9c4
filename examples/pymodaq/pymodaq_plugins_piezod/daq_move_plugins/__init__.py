"""The actuators; PyMoDAQ takes the modules beside `path`, by their names."""

from pathlib import Path

path = Path(__file__)
