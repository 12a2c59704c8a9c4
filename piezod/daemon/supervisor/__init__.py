"""The supervisor process: it starts the loop, connects it to the service, and ends it."""
