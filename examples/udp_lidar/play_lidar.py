"""Simulates a lidar in a room of 8 m by 6 m: python examples/udp_lidar/play_lidar.py [PORT [SECONDS]].

The lidar moves at 0.2 m/s for 10 s and then stops.
"""

import math
import socket
import sys
import time

import numpy as np
from lidar_packets import packets_of
from numpy.typing import NDArray

RATE_HZ, BEAMS, PARTS = 10.0, 360, 4
ROOM = (-3.0, -2.0, 5.0, 4.0)
"""Lowest x and y, then highest x and y of the walls, m."""


def ranges_at(x: float, y: float, bearings: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance to the walls, m."""
    cos, sin = np.cos(bearings), np.sin(bearings)
    with np.errstate(divide="ignore"):
        along = np.where(cos > 0.0, (ROOM[2] - x) / cos, np.where(cos < 0.0, (ROOM[0] - x) / cos, np.inf))
        across = np.where(sin > 0.0, (ROOM[3] - y) / sin, np.where(sin < 0.0, (ROOM[1] - y) / sin, np.inf))
    return np.minimum(along, across)


def main() -> None:
    """Send scans for the given time."""
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 2368
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else math.inf
    sender, began, number = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), time.monotonic(), 0
    step_deg = 360.0 / BEAMS
    bearings = np.radians(-180.0 + step_deg * np.arange(BEAMS))
    while (now := time.monotonic() - began) < seconds:
        ranges = ranges_at(0.2 * min(now, 10.0), 0.0, bearings)
        for packet in packets_of(number, round(1e6 * now), -180.0, step_deg, 100_000, ranges, PARTS):
            sender.sendto(packet, ("127.0.0.1", port))
        number += 1
        time.sleep(max(0.0, began + number / RATE_HZ - time.monotonic()))


if __name__ == "__main__":
    main()
