"""The `piezod` command: the only place that prints, and the only one that decides an exit code."""
