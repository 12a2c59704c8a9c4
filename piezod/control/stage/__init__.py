"""One stage: its state machine, its axes, its devices, and the requests made of it."""
