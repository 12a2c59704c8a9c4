"""Shared memory between loop and supervisor: records, events, requests, setpoints, counters."""
