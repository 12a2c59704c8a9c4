"""A day of a stage in virtual time: the daemon's own code, random commands, faults and restarts."""
