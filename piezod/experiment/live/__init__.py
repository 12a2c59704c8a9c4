"""Experiments and identifications on a running stage, through the client."""
