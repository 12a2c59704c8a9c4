"""Public helpers for testing drivers; never imported at run time."""
