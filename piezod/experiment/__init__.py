"""From an experiment file to a run, in virtual time or on a running stage, and its errors.

Knows no buses: devices come from the registry.
"""
