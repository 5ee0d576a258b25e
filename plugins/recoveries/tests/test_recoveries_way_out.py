"""The way out of a robot without room to turn: found, followed, and given up."""

import math

import numpy as np
import pytest
from navloom.geometry.footprints import rectangle
from navloom_recoveries.driving_out import TRIES, DrivingOut
from navloom_recoveries.motion import edges_of, gap_after
from navloom_recoveries.way_out import STEP, has_room, way_out

PERIOD = 0.05
LONG = rectangle(1.2, 0.4)
EDGES, RADIUS = edges_of(LONG), math.hypot(0.6, 0.2)
NOTHING = np.empty((0, 2))


def wall(beside: float) -> np.ndarray:
    """Points every 2.5 cm of a wall 8 m long to the right of the robot, at a gap, m."""
    along = np.arange(-4.0, 4.0, 0.025)
    return np.stack([along, np.full_like(along, -0.2 - beside)], axis=1)


def seen_from(points, pose):
    cos, sin, moved = math.cos(pose[2]), math.sin(pose[2]), points - np.array(pose[:2])
    return np.stack([cos * moved[:, 0] + sin * moved[:, 1], cos * moved[:, 1] - sin * moved[:, 0]], axis=1)


def drive(points, holds=lambda v, w: False, limit=60.0):
    """Poses of an ideal robot that drives out among points (k, 2), and whether it arrived."""
    out = DrivingOut(EDGES, RADIUS, 0.03, 0.15, math.radians(45.0), 0.0)
    out.start(0.0, 1)
    pose, speed, poses = (0.0, 0.0, 0.0), 0.0, [(0.0, 0.0, 0.0)]
    for tick in range(round(limit / PERIOD)):
        command = out.step(tick * PERIOD, pose, speed, seen_from(points, pose), NOTHING)
        if command is None:
            return np.array(poses), out.has_arrived
        v, w = (0.0, 0.0) if holds(*command) else command
        speed, middle = v, pose[2] + 0.5 * w * PERIOD
        pose = (pose[0] + v * PERIOD * math.cos(middle), pose[1] + v * PERIOD * math.sin(middle), pose[2] + w * PERIOD)
        poses.append(pose)
    raise AssertionError(f"did not end within {limit} s")


@pytest.mark.parametrize("beside", [0.05, 0.1, 0.2])
def test_a_way_ends_where_the_robot_has_room_and_keeps_its_margin(beside):
    way = way_out(wall(beside), EDGES, RADIUS, 0.02, RADIUS + 0.05, (True, False))
    assert has_room(seen_from(wall(beside), way[-1]), RADIUS + 0.05)
    assert (way[:, 4] == 1.0).all() and np.allclose(np.hypot(*np.diff(way[:, :2], axis=0).T), STEP, atol=1e-3)
    assert min(gap_after(seen_from(wall(beside), pose), EDGES, 0.0, 0.0, 0.0) for pose in way) > 0.019


def test_a_way_leaves_a_pocket_backwards():
    pocket = np.concatenate([wall(0.1), wall(0.1) * (1.0, -1.0), [(0.7, y) for y in np.arange(-0.3, 0.3, 0.025)]])
    pocket = pocket[pocket[:, 0] > -0.8]
    way = way_out(pocket, EDGES, RADIUS, 0.03, RADIUS + 0.05, (True, True))
    assert len(way) and way[0, 4] == -1.0 and way[-1, 0] < -1.4
    assert not len(way_out(pocket, EDGES, RADIUS, 0.03, RADIUS + 0.05, (True, False)))


def test_between_two_walls_there_is_no_way():
    assert not len(
        way_out(np.concatenate([wall(0.1), wall(0.1) * (1.0, -1.0)]), EDGES, RADIUS, 0.03, 0.7, (True, True))
    )


def test_it_drives_out_and_arrives_where_it_can_turn():
    poses, has_arrived = drive(wall(0.08))
    assert has_arrived and has_room(seen_from(wall(0.08), poses[-1]), RADIUS + 0.08)
    assert min(gap_after(seen_from(wall(0.08), pose), EDGES, 0.0, 0.0, 0.0) for pose in poses) > 0.015


def test_a_robot_with_room_does_not_drive():
    poses, has_arrived = drive(wall(0.6))
    assert len(poses) == 1 and not has_arrived


def test_where_the_gate_lets_it_only_drive_back_it_goes_back():
    poses, has_arrived = drive(wall(0.08), holds=lambda v, w: v > 0.0)
    assert has_arrived and poses[:, 0].max() == 0.0 and poses[-1, 0] < -0.5


def test_where_the_gate_lets_it_go_nowhere_it_gives_up():
    poses, has_arrived = drive(wall(0.08), holds=lambda v, w: True)
    assert not has_arrived and not poses.any() and len(poses) * PERIOD < TRIES * 4.0
