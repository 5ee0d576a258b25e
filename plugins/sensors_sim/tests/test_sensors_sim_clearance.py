"""Gap between footprint and obstacles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom import Box, Cylinder, Place, Raster
from navloom_sensors_sim.casting import NOTHING
from navloom_sensors_sim.clearance import RASTER_CAP, footprint_gap
from navloom_sensors_sim.scene import Scene

SQUARE = np.array([[-0.4, -0.4], [0.4, -0.4], [0.4, 0.4], [-0.4, 0.4]])
HEIGHT = 1.2


def gap(*obstacles, pose=(0.0, 0.0, 0.0), raster=None, footprint=SQUARE):
    return footprint_gap(pose, footprint, HEIGHT, Scene(obstacles, raster, sweeps=False).obstacles)


def test_nothing_to_meet():
    assert gap() == (math.inf, NOTHING)


def test_box_face_to_face():
    distance, index = gap(Box("far", (5.0, 6.0), (-1.0, 1.0)), Box("near", (1.0, 2.0), (-1.0, 1.0)))
    assert (distance, index) == (pytest.approx(0.6, abs=1e-12), 1)


def test_turned_robot_points_its_corner_at_the_box():
    distance, _ = gap(Box("b", (1.0, 2.0), (-1.0, 1.0)), pose=(0.0, 0.0, math.pi / 4))
    assert distance == pytest.approx(1.0 - 0.4 * math.sqrt(2.0), abs=1e-12)


def test_corner_to_corner():
    """From (0.4, 0.4) to (0.7, 0.8): 3-4-5."""
    assert gap(Box("b", (0.7, 2.0), (0.8, 2.0)))[0] == pytest.approx(0.5, abs=1e-12)


def test_turned_box_points_its_corner_at_the_robot():
    distance, _ = gap(Box("b", (1.0, 3.0), (-1.0, 1.0), yaw=math.pi / 4))
    assert distance == pytest.approx(2.0 - math.sqrt(2.0) - 0.4, abs=1e-12)


def test_cylinder_from_corner():
    """From the corner (0.4, 0.4) to (3.4, 4.4): 5 m, less the radius."""
    assert gap(Cylinder("c", 3.4, 4.4, 1.5))[0] == pytest.approx(3.5, abs=1e-12)


@pytest.mark.parametrize(
    "obstacle",
    [
        Box("overlaps", (0.3, 1.0), (-0.1, 0.1)),
        Box("touches", (0.4, 1.0), (-0.1, 0.1)),
        Box("inside the robot", (-0.1, 0.1), (-0.1, 0.1)),
        Box("around the robot", (-9.0, 9.0), (-9.0, 9.0)),
        Box("crosses without a corner inside", (-2.0, 2.0), (-0.1, 0.1)),
        Cylinder("touches", 1.4, 0.0, 1.0),
        Cylinder("inside the robot", 0.1, 0.1, 0.05),
    ],
    ids=lambda o: o.name,
)
def test_contact(obstacle):
    assert gap(obstacle) == (0.0, 0)


@pytest.mark.parametrize("obstacle", [Box("b", (0.41, 1.0), (-1.0, 1.0)), Cylinder("c", 1.41, 0.0, 1.0)])
def test_one_centimetre_is_no_contact(obstacle):
    assert gap(obstacle)[0] == pytest.approx(0.01, abs=1e-12)


def test_obstacles_above_the_robot_or_below_the_floor_do_not_count():
    over, under = Box("over", (-1.0, 1.0), (-1.0, 1.0), (1.4, 1.6)), Cylinder("under", 0.0, 0.0, 1.0, (-1.0, 0.0))
    assert gap(over, under) == (math.inf, NOTHING)
    assert gap(Box("low girder", (-1.0, 1.0), (-1.0, 1.0), (0.9, 1.1))) == (0.0, 0)


def test_footprint_away_from_the_base_origin():
    """A triangle whose tip is 2 m ahead of the base's origin."""
    triangle = np.array([[1.0, -0.5], [2.0, 0.0], [1.0, 0.5]])
    assert gap(Box("b", (2.5, 3.0), (-1.0, 1.0)), footprint=triangle)[0] == pytest.approx(0.5, abs=1e-12)
    assert gap(Box("b", (-0.5, 0.5), (-1.0, 1.0)), footprint=triangle)[0] == pytest.approx(0.5, abs=1e-12)


def one_cell(x):
    """A raster of 0.1 m cells whose one wall cell begins at this x and spans y -0.05..0.05."""
    return Raster("r", np.array([[False, True]]), 0.1, Place(x - 0.1, -0.05))


def test_raster_cell():
    assert gap(raster=one_cell(1.0)) == (pytest.approx(0.6, abs=1e-12), 0)
    assert gap(raster=one_cell(0.39)) == (0.0, 0)


def test_raster_beyond_the_cap_gives_the_cap():
    assert gap(raster=one_cell(2.39)) == (pytest.approx(1.99, abs=1e-12), 0)
    assert gap(raster=one_cell(9.0)) == (RASTER_CAP, NOTHING)


def test_raster_above_the_robot_does_not_count():
    above = Raster("r", np.ones((9, 9), bool), 0.5, Place(-2.0, -2.0), (1.3, 2.0))
    assert gap(raster=above) == (math.inf, NOTHING)


def test_robot_deep_inside_a_raster_wall_is_in_contact():
    assert gap(raster=Raster("r", np.ones((90, 90), bool), 0.1, Place(-4.5, -4.5))) == (0.0, 0)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_raster_gap_agrees_with_one_box_a_cell(seed):
    rng = np.random.default_rng(seed)
    cell, heading = rng.uniform(0.05, 0.4), rng.uniform(-3, 3)
    occupied = rng.random((30, 30)) < rng.choice([0.002, 0.01, 0.1])
    place = Place(*rng.uniform(-4, 1, 2), heading)
    c, s = math.cos(heading), math.sin(heading)
    boxes = []
    for row, col in np.argwhere(occupied):
        u, v = (col + 0.5) * cell, (row + 0.5) * cell
        x, y = place.x + c * u - s * v, place.y + s * u + c * v
        boxes.append(Box("b", (x - cell / 2, x + cell / 2), (y - cell / 2, y + cell / 2), yaw=heading))
    pose = (*rng.uniform(-3, 3, 2), rng.uniform(-3, 3))
    expected = min(gap(*boxes, pose=pose)[0], RASTER_CAP)
    assert gap(pose=pose, raster=Raster("r", occupied, cell, place))[0] == pytest.approx(expected, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_gap_is_the_least_distance_of_points_on_the_rims(seed):
    """Rims sampled every 2 cm or closer never come nearer than the gap, and come as near as their spacing allows."""
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(-np.pi, np.pi, 7))
    polygon = 0.5 * np.column_stack([np.cos(angles), np.sin(angles)])
    box = Box("b", (1.2, 1.2 + rng.uniform(0.1, 2.0)), (-0.5, rng.uniform(-0.4, 2.0)), yaw=rng.uniform(-0.3, 0.3))
    distance, _ = gap(box, footprint=polygon)
    (cx, cy), c, s = box.centre, math.cos(box.yaw), math.sin(box.yaw)
    corners = np.array([[box.x[i], box.y[j]] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]) - [cx, cy]
    corners = corners @ np.array([[c, s], [-s, c]]) + [cx, cy]
    rims = [
        (p + np.linspace(0, 1, 101)[:, None, None] * (np.roll(p, -1, 0) - p)).reshape(-1, 2) for p in (polygon, corners)
    ]
    sampled = min(np.hypot(*(rims[1] - point).T).min() for point in rims[0])
    assert distance <= sampled + 1e-12
    assert sampled - distance < 0.02
