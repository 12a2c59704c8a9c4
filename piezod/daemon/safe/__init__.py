"""Brings a stage without a loop to its safe voltage."""
