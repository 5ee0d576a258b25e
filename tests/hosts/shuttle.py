"""Drives a robot to and fro between places until it is ended: `python shuttle.py ROBOT ENDPOINT KEYS X,Y X,Y …`.

KEYS is a folder of certificates, or `-` for plain TCP. It prints a line for the end of each goal.
"""

from __future__ import annotations

import itertools
import sys

from navloom_live.operating.client import ClientError, Refused
from navloom_live.operating.navigator import Navigator

__all__ = ["main"]


def main(robot: str, endpoint: str, keys: str, *places: str) -> None:
    """Drive until ended."""
    plain = keys == "-"
    with Navigator(robot, endpoint, None if plain else keys, insecure=plain) as navigator:
        for place in itertools.cycle(places):
            x, y = (float(value) for value in place.split(","))
            try:
                result = navigator.drive_to(x, y, timeout=180.0)
            except (ClientError, Refused, TimeoutError) as error:
                print(f"no goal: {error}", flush=True)
                continue
            print(f"{result.outcome}: {result.reason}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
