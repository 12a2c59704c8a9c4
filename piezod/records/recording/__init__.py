"""Recordings of every cycle of a running stage: their files, and what is in them."""
