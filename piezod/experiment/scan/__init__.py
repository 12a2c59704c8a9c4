"""Scans: lines, rasters and stacks that a device plays, learned, and stored pixel by pixel.

`plan.py` says where the stage is when, `learn.py` finds the voltages, `pixels.py` makes pixels of
the record. The stage is virtual or running.
"""
