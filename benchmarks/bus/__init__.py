"""The cost of a cycle over a bus, compared with plain system calls for the same bytes."""
