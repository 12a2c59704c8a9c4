"""Commands that run, end and serve the daemon of a stage, and its parameters."""
