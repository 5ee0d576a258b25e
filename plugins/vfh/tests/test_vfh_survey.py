"""One survey of the window: its openings, with the turning circle at the current speed and without, and its slots."""

import math

import numpy as np
from navloom.testing import robot
from navloom_avoidance.histogram import free_slots
from navloom_avoidance.robot import Robot
from navloom_vfh.methods import VfhAvoidance
from navloom_vfh.params import VfhParams
from navloom_vfh.survey import survey_openings

N, SIZE, CELL, RADIUS = 72, 41, 0.1, 0.3
BODY = np.empty((0, 3))


def survey(is_wall, circle):
    """Openings, directions and `must_slow` inside a ring of cells, 0.8 to 1 m away where `is_wall(bearing_deg)`."""
    middle = CELL * (np.arange(SIZE) - SIZE // 2)
    x, y = np.meshgrid(middle, middle)
    distance, bearing_deg = np.hypot(x, y), np.degrees(np.arctan2(y, x))
    grid = np.where((distance > 0.8) & (distance < 1.0) & is_wall(bearing_deg), 15, 0).astype(np.uint8)
    origin = np.full(2, -(SIZE // 2), np.int64)
    _, openings, directions, must_slow, _ = survey_openings(
        (grid, origin, CELL), (0.05, 0.05, 0.0), BODY, RADIUS, 1.6, math.inf, (0.1, 0.2), circle, 3.0, 16, 0.0,
        np.zeros((SIZE * SIZE, 3)), np.zeros(N), np.zeros(N), np.zeros((N // 2 + 1, 2), np.int64),
        np.zeros(3 * (N // 2 + 1)),
    )  # fmt: skip
    return openings, directions, must_slow


def gap_on_the_left(bearing_deg):
    """A wall with a gap of 90 degrees on the left, from 45 to 135 degrees."""
    return np.abs(bearing_deg - 90.0) > 45.0


def closed(bearing_deg):
    return np.abs(bearing_deg) <= 180.0


def test_a_robot_too_fast_to_turn_into_the_only_opening_must_slow():
    """The left circle of 1 m is about (0, 1); the wall at (0.7, 0.6) is 0.81 m from it, less than 1.3 m. The opening is
    90 degrees less arcsin(0.3 / 0.9) = 19 on each side, below s_max = 80 degrees: one direction."""
    assert survey(gap_on_the_left, circle=1.0) == (1, 1, True)


def test_a_stopped_robot_need_not_slow_for_the_same_opening():
    assert survey(gap_on_the_left, circle=0.0) == (1, 1, False)


def test_where_no_direction_is_free_slowing_does_not_help():
    assert survey(closed, circle=1.0) == (0, 0, False)


def test_every_second_sector_can_be_a_slot_of_its_own():
    """72 sectors, free and blocked in turn: 36 slots of one sector."""
    method = VfhAvoidance(VfhParams(), Robot.of(robot()), 0.05)
    assert free_slots(np.tile([0.0, 1.0], 36), 0.5, method.slots) == 36
    assert sorted(method.slots[:36].tolist()) == [[k, 1] for k in range(0, 72, 2)]
