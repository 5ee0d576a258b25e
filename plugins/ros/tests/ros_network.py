"""A robot's ROS network on loopback, for tests: a Zenoh router at a free port in place of `rmw_zenohd`."""

from __future__ import annotations

import json
import socket
import time

import zenoh


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Router:
    """A router that can be stopped and restarted at the same endpoint."""

    def __init__(self) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.start()

    def start(self) -> None:
        """Listen."""
        settings = {
            "mode": "router",
            "listen": {"endpoints": [self.endpoint]},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True}},
            "timestamping": {"enabled": True},
        }
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))

    def stop(self) -> None:
        """Break all links."""
        self._session.close()

    def __enter__(self) -> Router:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def until(condition, timeout=5.0):
    """Poll a condition every 5 ms until it is true or `timeout` s have passed; returns its last value."""
    end = time.monotonic() + timeout
    while not (found := condition()) and time.monotonic() < end:
        time.sleep(0.005)
    return found
