"""A mission: drive a live robot to several places, one after the other, and report how each drive ended.

    navloom up examples/turtle/turtle.toml        # in another terminal: any robot that is up
    python examples/mission.py 1,0.5 1,1 0,0

The robot is the only one that is up on this host; name another with --robot.
"""

import argparse
import sys

from navloom import Navigator


def main() -> int:
    """Run the mission; exit code 0 if every place was reached."""
    parser = argparse.ArgumentParser(description="Drive a live robot over several places.")
    parser.add_argument("places", nargs="+", metavar="X,Y", type=place, help="m, map frame")
    parser.add_argument("--robot", metavar="NAME", help="which robot; default: the only one that is up")
    parser.add_argument("--patience", metavar="S", type=float, default=60.0, help="longest wait for one place, s")
    given = parser.parse_args()
    missed = 0
    with Navigator(given.robot) as robot:
        for x, y in given.places:
            try:
                result = robot.drive_to(x, y, timeout=given.patience)
            except TimeoutError as error:
                robot.cancel()  # otherwise it continues to drive
                print(f"({x:g}, {y:g}): given up: {error}")
                missed += 1
                continue
            end = result.place
            print(f"({x:g}, {y:g}): {result.outcome}, {result.reason}, at ({end.x:.2f}, {end.y:.2f})")
            missed += result.outcome != "succeeded"
    print(f"{len(given.places) - missed} of {len(given.places)} places reached")
    return 1 if missed else 0


def place(text: str) -> tuple[float, float]:
    """Parse the coordinates X,Y of a place, m."""
    x, y = text.split(",")
    return float(x), float(y)


if __name__ == "__main__":
    sys.exit(main())
