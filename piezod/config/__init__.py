"""Configuration files: their models, and a loader that reports errors with file, line and column.

The package imports no other room; a driver supplies the model of its own options.
"""
