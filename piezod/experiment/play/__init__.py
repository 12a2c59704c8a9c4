"""Waveforms that a device plays from a table, learned pass by pass.

`learn.py` is the procedure; the stage that it plays on is a `PlayedStage`, virtual or running.
"""
