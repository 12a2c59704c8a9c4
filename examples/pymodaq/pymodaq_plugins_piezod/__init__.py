"""Stages of piezod as actuators of PyMoDAQ."""
