"""The map as a limit beside the scans': where its surfaces are, and when they count."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.geometry.footprints import rectangle
from navloom.messages import OccupancyGrid, Odometry, Pose2D, PoseEstimate, Twist2D
from navloom.navigation.monitor import CollisionMonitor, MonitorLimits, Verdict
from navloom.navigation.monitor_map import NO_SURFACES, surfaces_without_echo

LIMITS = MonitorLimits(rectangle(1.2, 0.4), period=0.05, deceleration=1.0)
STILL = Twist2D(0.0, 0.0, 0.0)
TURN = Twist2D(0.0, 0.0, 0.5)
BASE = Pose2D(0.0, 0.0, 0.0)


def wall(y: float) -> OccupancyGrid:
    """Cells of 5 cm below a line, 4 m wide, the map's x from -2 to 2; free above it."""
    cells = np.zeros((80, 80), np.int8)
    cells[:10] = 100
    return OccupancyGrid(cells, 0.05, Pose2D(-2.0, y - 0.5, 0.0))


def verdict(
    grid: OccupancyGrid | None, twist: Twist2D = TURN, state: str = "tracking", base: Pose2D = BASE, age: float = 0.0
) -> Verdict:
    """What a monitor without scans lets pass of the first command."""
    monitor = CollisionMonitor(LIMITS)
    for tick in range(41):
        monitor.move(Odometry(tick * 50_000_000, BASE, STILL))
    stamp_ns = 2_000_000_000 - round(age * 1e9)
    monitor.locate(PoseEstimate(stamp_ns, base, STILL, np.zeros((3, 3)), state), grid)  # type: ignore[arg-type]
    return monitor.judge(twist, 0.0, 2.0)


def test_a_surface_is_the_edge_between_an_occupied_cell_and_another_in_steps_of_half_a_cell() -> None:
    cells = np.array([[100, -1]], np.int8)
    found = surfaces_without_echo(OccupancyGrid(cells, 0.05, Pose2D(1.0, 0.0, 0.0)), BASE, 2.0, NO_SURFACES)
    expected = [
        (1.05, 0.0),
        (1.05, 0.025),
        (1.05, 0.05),
        (1.025, 0.05),
        (1.0, 0.05),
        (1.0, 0.025),
        (1.0, 0.0),
        (1.025, 0),
    ]
    assert sorted(map(tuple, found.round(9).tolist())) == sorted(expected)


def test_surfaces_are_in_the_base_frame_of_a_turned_robot_on_a_turned_map() -> None:
    grid = OccupancyGrid(np.full((1, 1), 100, np.int8), 0.02, Pose2D(1.0, 2.0, math.pi / 2))
    found = surfaces_without_echo(grid, Pose2D(1.0, 0.0, math.pi / 2), 3.0, NO_SURFACES)
    assert found.min(axis=0) == pytest.approx([2.0, 0.0]) and found.max(axis=0) == pytest.approx([2.02, 0.02])


def test_what_three_echoes_show_is_left_to_the_scans() -> None:
    grid = wall(-0.5)
    near = np.array([(0.0, -0.6), (0.01, -0.42), (-0.02, -0.5)])
    left = surfaces_without_echo(grid, BASE, 0.6, near)
    assert np.abs(left[:, 0]).min() > 0.02 and len(left) == len(surfaces_without_echo(grid, BASE, 0.6, near[:2])) - 3
    assert len(surfaces_without_echo(grid, BASE, 0.6, near - (0.0, 0.3))) == len(left) + 3  # 0.3 m behind it: glass


def test_a_turn_beside_a_mapped_wall_that_no_scan_shows_is_stopped() -> None:
    assert verdict(wall(-0.21)).is_stopped  # within the margin, and the rear corner comes nearer
    assert verdict(None).share == verdict(wall(-0.7)).share == 1.0  # the corner's circle has a radius of 0.632 m


@pytest.mark.parametrize("state", ["searching", "lost"])
def test_the_map_does_not_count_while_the_localizer_does_not_track(state: str) -> None:
    assert verdict(wall(-0.21), state=state).share == 1.0


def test_the_map_does_not_count_for_a_pose_older_than_a_second() -> None:
    assert verdict(wall(-0.21), age=0.9).is_stopped and verdict(wall(-0.21), age=1.1).share == 1.0


def test_a_free_map_makes_no_unseen_space_free() -> None:
    back = Twist2D(-0.5, 0.0, 0.0)
    free = OccupancyGrid(np.zeros((80, 80), np.int8), 0.05, Pose2D(-2.0, -2.0, 0.0))
    assert verdict(free, back) == verdict(None, back) and verdict(free, back).kind == "unseen"


def test_a_mapped_wall_within_the_margin_holds_a_robot_only_if_it_comes_nearer() -> None:
    inside = wall(-0.195)  # by the map the robot is 5 mm and more in the wall
    forward = Twist2D(0.04, 0.0, 0.0)
    assert verdict(inside, forward, base=Pose2D(0.0, 0.0, math.radians(5.0))).share == 1.0
    assert verdict(inside, forward, base=Pose2D(0.0, 0.0, math.radians(-5.0))).is_stopped
    assert verdict(inside, TURN).is_stopped


@pytest.mark.parametrize(("speed", "share"), [(0.04, 1.0), (0.3, 0.05 / 0.3)])
def test_up_to_5_cm_a_second_a_corner_may_come_nearer_by_two_percent_of_the_way(speed: float, share: float) -> None:
    cells = wall(-0.205).cells.copy()
    cells[:, 40:] = 0  # the wall, 5 mm beside the robot, ends at its middle
    beside = OccupancyGrid(cells, 0.05, wall(-0.205).origin)
    for curvature, lets_pass in ((0.02, True), (0.1, False)):  # the rear corner, 0.6 m behind, nears by 1.2 and 6 %
        found = verdict(beside, Twist2D(speed, 0.0, curvature * speed))
        assert found.share == pytest.approx(share, abs=1 / 32) if lets_pass else found.share < 0.1
