"""UDP ports for groups of a test."""

import socket


def free_port() -> int:
    """Return a port that nobody uses now; groups of other tests do not hear what comes to it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port: int = probe.getsockname()[1]
    return port
