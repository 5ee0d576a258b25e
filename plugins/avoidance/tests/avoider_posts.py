"""Echoes for tests of single ticks: each marks one cell of 0.1 m, whose centre is at an odd multiple of 0.05 m."""

import math

import numpy as np
from avoider_scans import SQUARE, given
from navloom import RangeScan
from navloom.testing import context, make, robot

EVERYWHERE = np.arange(0.0, 360.0, 5.0)
SLIM = SQUARE * (1.0, 0.375)
"""A footprint for posts beside the robot: 0.8 m long, 0.3 m wide."""


def preset(method, name, footprint=SQUARE, period=0.05, changes=None, **limits):
    """An avoider with one of its shipped presets, on the paper's robot, whose own limits are out of the way."""
    limits = {"max_linear": 2.0, "max_angular": math.pi, **limits}
    within = context(robot(footprint=footprint, **limits), role="avoider", period=period)
    return make(method, within, **{**method.presets[name].values(), **(changes or {})})


def cones(directions, ranges, heading=0.0, half_angle=0.021, range_min=0.1, origin=(0.0, 0.0)):
    """A scan of narrow cones; directions in the pose frame and heading in degrees, m; origin in the base frame, m."""
    bearings = np.radians(np.asarray(directions, np.float64) - heading)
    n = bearings.size
    found = np.broadcast_to(ranges, n).astype(np.float64)
    return RangeScan(
        0, np.tile(origin, (n, 1)), bearings, np.full(n, half_angle), np.zeros(n), found, range_min, 4.0
    )  # fmt: skip


def posts(*points, x=0.05, heading=0.0):
    """Echoes of the cells with these centres, m, axes of the pose frame; the robot is at (x, 0)."""
    return cones([math.degrees(math.atan2(py, px - x)) for px, py in points],
                 [math.hypot(px - x, py) for px, py in points], heading)  # fmt: skip


def ring(*openings, heading=0.0, width=40.0, distance=0.637):
    """Echoes in all directions but those of the openings; degrees, pose frame."""
    closed = [d for d in EVERYWHERE + 2.5 if all(abs((d - o + 180.0) % 360.0 - 180.0) > width for o in openings)]
    return cones(closed, distance, heading)


def tick(avoider, *scans, heading=0.0, x=0.05, target=0.0, distance=5.0, **others):
    """The answer for a target in a direction, degrees, and at a distance, m."""
    place = (x + distance * math.cos(math.radians(target)), distance * math.sin(math.radians(target)))
    return avoider.avoid(given(*scans, x=x, heading=math.radians(heading), target=place, **others))


def drive(avoider, *scans, **others):
    """Forward speed, m/s, and turn rate, degrees per second."""
    answer = tick(avoider, *scans, **others)
    return answer.twist.vx, math.degrees(answer.twist.wz)
