"""The fault table, and the register that keeps faults from cycle to cycle."""
