"""UDP ports for multicast groups of tests."""

import socket


def free_port() -> int:
    """Return an unused port, so that groups of other tests receive nothing of this one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port: int = probe.getsockname()[1]
    return port
