"""The fault table, and the register that remembers faults from cycle to cycle."""
