"""Surroundings and ticks for the tests of MPPI."""

import math

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.clearance import footprint_edges
from navloom_avoidance.robot import Robot
from navloom_dwa.field import fill_field, obstacle_distance
from navloom_mppi.control import Given, PathIntegral
from navloom_mppi.critics import Scene
from navloom_mppi.nearest import body_points, fill_nearest
from navloom_mppi.params import MppiParams

JACKAL = np.array([[0.229, 0.208], [-0.229, 0.208], [-0.229, -0.208], [0.229, -0.208]])
SQUARE = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
HERE = (0.0, 0.0, 0.0)
BEARINGS = np.linspace(-math.pi, math.pi, 360, endpoint=False)


def scene_of(obstacles=(), path=((0.0, 0.0), (3.0, 0.0)), footprint=SQUARE, soft=0.3, **changes):
    """Surroundings with obstacles (x, y, margin), m, and a path; fields of 0.1 m cells."""
    points, path = np.array(obstacles, dtype=float).reshape(-1, 3), np.array(path, dtype=float)
    distance, cost_to_go, beside = (np.zeros((80, 80), np.int32) for _ in range(3))
    nearest, squares, origin = np.zeros((160, 160), np.int32), np.zeros((160, 160), np.float32), np.zeros(2, np.int64)
    body, disc = body_points(footprint)
    fill_nearest(points, 0.05, disc + soft + 0.1, nearest, squares)
    end = (float(path[-1, 0]), float(path[-1, 1]))
    fill_field(points, HERE, end, origin, 0.1, 0.4, 0.3, 3.0, distance, cost_to_go)
    cells = np.column_stack(
        [np.interp(np.arange(0, 1, 0.01), np.linspace(0, 1, len(path)), path[:, a]) for a in (0, 1)]
    )
    obstacle_distance(cells, HERE, origin, 0.1, beside)
    scene = Scene(
        points, nearest, 20.0, 0.5, body, footprint_edges(footprint), soft, cost_to_go, beside, origin, 0.1, end, False,
        end, False, True, math.nan,
    )  # fmt: skip
    return scene._replace(**changes)


def still(x=0.0, y=0.0, heading=0.0, steps=8):
    """A track that stays at a pose."""
    return np.tile([x, y, heading, math.cos(heading), math.sin(heading)], (steps, 1))


def method_of(footprint=JACKAL, seed=0, robot=None, **params):
    """MPPI on the Jackal, or another robot, with fewer roll-outs than usual."""
    if robot is None:
        robot = Robot(footprint, 2.0, math.pi, 2.0, 2.0, motor_lag=0.1, dead_time=0.05, half_track=0.19)
    return PathIntegral(MppiParams(**{"samples": 600} | params), robot, 0.05, np.random.default_rng(seed))


def laser(posts, pose=HERE, radius=0.1):
    """A scan of 360 beams all round that sees posts (x, y), m, map frame."""
    ranges = np.full(BEARINGS.size, np.inf)
    for x, y in posts:
        distance = math.hypot(x - pose[0], y - pose[1])
        off = (BEARINGS - math.atan2(y - pose[1], x - pose[0]) + pose[2] + math.pi) % math.tau - math.pi
        hit = np.abs(off) < math.asin(min(1.0, radius / distance))
        ranges[hit] = np.minimum(ranges[hit], max(0.05, distance - radius))
    n = BEARINGS.size
    limits = np.tile([0.05, 10.0], (n, 1))
    return Beams.fixed(np.zeros((n, 2)), BEARINGS, np.zeros(n), ranges, limits, np.zeros(n, np.int64))


def line(x, y):
    """The straight path from the origin to a point, m, in steps of about 5 cm."""
    return np.outer(np.linspace(0.0, 1.0, max(2, round(math.hypot(x, y) / 0.05))), [x, y])


def drive_to(method, path, seconds, posts=(), turn_to=None, near=0.1):
    """Drive an ideal robot: (n, 5) x, y, heading, speed, turn rate in each tick, until it is near the end."""
    x, y, heading, twist, driven = 0.0, 0.0, 0.0, (0.0, 0.0), []
    for k in range(round(seconds / 0.05)):
        at = int(np.argmin(np.hypot(path[:, 0] - x, path[:, 1] - y)))
        beams = [laser(posts, (x, y, heading))] if posts else []
        given = Given(0.05 * k, (x, y, heading), twist, path[at:], turn_to)
        decision = method.step(beams, None, given)
        twist = (decision.speed, decision.turn)
        heading = math.remainder(heading + 0.05 * twist[1], math.tau)
        x, y = x + 0.05 * twist[0] * math.cos(heading), y + 0.05 * twist[0] * math.sin(heading)
        driven.append((x, y, heading, *twist))
        is_there = math.hypot(x - path[-1, 0], y - path[-1, 1]) < near
        if is_there and (turn_to is None or abs(math.remainder(heading - turn_to, math.tau)) < 0.05):
            break
    return np.array(driven)
