"""Experiments in virtual time, on devices that this process owns."""
