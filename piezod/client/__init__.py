"""The typed client of a running daemon, sync and async."""
