"""From an experiment file to a run in virtual time, its records and its metrics.

Knows nothing of buses: devices come from the registry.
"""
