"""A page for the stages of this machine: a process of its own, between browsers and daemons."""
