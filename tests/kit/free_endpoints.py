"""Addresses of this machine that no program listens at."""

import socket


def find_free_endpoint() -> str:
    """Return an endpoint of Zenoh on a free port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"
