"""Commands for several stages as one."""
