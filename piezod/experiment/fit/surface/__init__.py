"""The fit of a surface, with its creep, its delay, and the first mode."""
