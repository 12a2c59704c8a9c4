"""The running stage: everything that the service asks of it."""
