"""Watches: each takes the values of one cycle and returns the faults that it detects."""
