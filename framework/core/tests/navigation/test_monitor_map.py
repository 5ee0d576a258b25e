"""The map as a limit beside the scans': where its surfaces are, and when they count."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.messages import OccupancyGrid, Odometry, Pose2D, PoseEstimate, RangeScan, Twist2D
from navloom.navigation.collision_monitor import CollisionMonitor, MonitorLimits, Verdict
from navloom.navigation.monitor_echoes import SensorEchoes
from navloom.navigation.monitor_map import NO_SURFACES, shown_aside, surfaces_without_echo
from navloom.testing import robot

LIMITS = MonitorLimits(robot(1.2, 0.4), 0.05, 0.03)
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


# --- surfaces by hand-worked numbers ----------------------------------------------------------------------------------


def grid_of(*rows: str, cell: float = 0.05, at: Pose2D = BASE) -> OccupancyGrid:
    """A map whose rows are given from the lowest: `#` is occupied, `.` free, `?` unknown."""
    values = {"#": 100, ".": 0, "?": -1}
    return OccupancyGrid(np.array([[values[letter] for letter in row] for row in rows], np.int8), cell, at)


def surfaces(grid: OccupancyGrid, base: Pose2D = BASE, reach: float = 9.0, echoes: object = ()) -> list[list[float]]:
    points = np.array(echoes, dtype=float).reshape(-1, 2)
    found: list[list[float]] = sorted(surfaces_without_echo(grid, base, reach, points).round(9).tolist())
    return found


def test_cells_that_touch_have_no_surface_between_them() -> None:
    """Two cells in a corner of the map, one on the other, of 2 cm: the outline has six edges of one point each."""
    expected = [[0.0, 0.0], [0.0, 0.02], [0.0, 0.04], [0.02, 0.0], [0.02, 0.02], [0.02, 0.04]]
    assert surfaces(grid_of("#..", "#..", cell=0.02)) == expected
    assert surfaces(grid_of("...", "##.", cell=0.02)) == [[x, y] for x in (0.0, 0.02, 0.04) for y in (0.02, 0.04)]


def test_a_row_of_cells_has_all_its_points_and_each_once() -> None:
    """Sixty cells of 5 cm: 120 points above and below, two at each end; of them, 244 in all."""
    found = surfaces(grid_of("." * 62, "." + "#" * 60 + ".", "." * 62))
    assert len(found) == len({tuple(point) for point in found}) == 244
    for y in (0.05, 0.075, 0.1):
        xs = [x for x, at in found if at == y]
        assert (min(xs), max(xs)) == (0.05, 3.05), y
    assert sum(y == 0.05 for _, y in found) == sum(y == 0.1 for _, y in found) == 121


def test_only_surfaces_within_reach_count() -> None:
    """From (0.3, 0.3), a wall of 2.5 cm steps 0.2 m to the right: x and y in the base frame, at most 0.25 m away."""
    grid = grid_of(*["." * 10 + "##"] * 12)
    found = surfaces(grid, Pose2D(0.3, 0.3, 0.0), 0.2501)
    assert found == [[0.2, y / 1000] for y in range(-150, 151, 25)]
    assert surfaces(grid, Pose2D(0.3, 0.3, 0.0), 0.199) == []


@pytest.mark.parametrize(
    ("depth", "along", "shown"),
    [(0.149, 0.0, True), (-0.149, 0.0, True), (0.151, 0.0, False), (-0.151, 0.0, False), (0.0, 0.049, True),
     (0.0, -0.049, True), (0.0, 0.051, False), (0.0, -0.051, False), (0.1, 0.04, True)],
)  # fmt: skip
@pytest.mark.parametrize("heading", [0.0, 0.7, -2.0])
def test_three_echoes_show_a_point_up_to_15_cm_before_or_behind_and_5_cm_beside_it(
    depth: float, along: float, shown: bool, heading: float
) -> None:
    """One cell of 2 cm; the point of its right edge, whose normal is the map's x axis, is the corner (0.02, 0)."""
    grid = grid_of("#", cell=0.02, at=Pose2D(0.0, 0.0, heading))
    cos, sin = math.cos(heading), math.sin(heading)

    def place(x: float, y: float) -> tuple[float, float]:
        return round(cos * x - sin * y, 9), round(sin * x + cos * y, 9)

    echo = place(0.02 + depth, along)
    found = [tuple(point) for point in surfaces(grid, echoes=[echo] * 3)]
    assert (place(0.02, 0.0) not in found) is shown
    assert len(surfaces(grid, echoes=[echo] * 2)) == 4, "two are not enough"


def placed(stamp: float, pose: Pose2D, grid: OccupancyGrid) -> CollisionMonitor:
    """A monitor with a pose of a time; at 1.0 s the odometry is (2, 1, 0), at 1.2 s (2.3, 1.1, 0.5)."""
    made = CollisionMonitor(LIMITS)
    for time, odometry in ((1.0, Pose2D(2.0, 1.0, 0.0)), (1.2, Pose2D(2.3, 1.1, 0.5))):
        made.move(Odometry(round(time * 1e9), odometry, STILL))
    made.locate(PoseEstimate(round(stamp * 1e9), pose, STILL, np.zeros((3, 3))), grid)
    return made


def test_a_pose_is_carried_along_by_the_odometry_since() -> None:
    """At (4, 5), heading 90 degrees, it drives 0.3 m ahead and 0.1 m to the left: (3.9, 5.3), and turns by 0.5 rad."""
    grid = grid_of("#", cell=0.02, at=Pose2D(4.3, 5.5, 0.0))
    found = placed(1.0, Pose2D(4.0, 5.0, math.pi / 2), grid)._surfaces(2.0, np.empty((0, 2)))
    expected = surfaces_without_echo(grid, Pose2D(3.9, 5.3, math.pi / 2 + 0.5), 2.0, NO_SURFACES)
    assert len(found) == 4 and found == pytest.approx(expected)
    half = placed(1.1, Pose2D(4.0, 5.0, math.pi / 2), grid)._surfaces(2.0, np.empty((0, 2)))
    # Half-way the odometry heads 0.25 rad: of the 0.15 m and 0.05 m since, in that frame, ahead is north of the map.
    ahead, left = 0.15 * math.cos(0.25) + 0.05 * math.sin(0.25), 0.05 * math.cos(0.25) - 0.15 * math.sin(0.25)
    there = Pose2D(4.0 - left, 5.0 + ahead, math.pi / 2 + 0.25)
    assert half == pytest.approx(surfaces_without_echo(grid, there, 2.0, NO_SURFACES))


def test_a_pose_of_the_newest_odometry_or_later_is_taken_as_it_is() -> None:
    grid, pose = grid_of("#", cell=0.02, at=Pose2D(4.3, 5.5, 0.0)), Pose2D(4.0, 5.0, 1.0)
    for stamp in (1.2, 1.25):
        found = placed(stamp, pose, grid)._surfaces(2.0, np.empty((0, 2)))
        assert found == pytest.approx(surfaces_without_echo(grid, pose, 2.0, NO_SURFACES)) and len(found) == 4


def test_a_pose_of_before_the_first_odometry_does_not_count() -> None:
    grid, pose = grid_of("#", cell=0.02, at=Pose2D(4.3, 5.5, 0.0)), Pose2D(4.0, 5.0, 1.0)
    assert len(placed(0.99, pose, grid)._surfaces(2.0, np.empty((0, 2)))) == 0


def test_echoes_and_mapped_surfaces_are_points_of_one_frame() -> None:
    """Of a wall that ends 0.2 m beside the robot, in 13 mapped points; nothing lies beyond a mapped surface."""
    made = placed(1.2, Pose2D(0.3, 0.3, 0.0), grid_of(*["." * 10 + "##"] * 12))
    near = made._near(Twist2D(0.5, 0.0, 0.0), 0.0)
    assert near.shape[1] == 3 and not near[:, 2].any()
    assert [0.2, 0.0, 0.0] in near.round(9).tolist()


# --- objects that are seen ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("away", "count", "shown"), [(0.149, 3, True), (0.151, 3, False), (0.149, 2, False)])
def test_three_echoes_within_a_cell_and_10_cm_show_an_object(away: float, count: int, shown: bool) -> None:
    flank = np.array([(0.7, -0.3), (5.0, 5.0)])
    echoes = np.tile((0.7 - 0.6 * away, -0.3 + 0.8 * away), (count, 1))
    assert shown_aside(flank, echoes, 0.05).tolist() == [shown, False]
    assert shown_aside(np.empty((0, 2)), echoes, 0.05).tolist() == []


def test_a_laser_covers_the_directions_of_its_beams_from_its_own_place() -> None:
    """Beams of 1° from -20 to 20°, from a laser 0.2 m ahead of a base at (3, -1) that heads for 90°."""
    sensor, bearings = SensorEchoes(0.01), np.radians(np.arange(-20.0, 21.0))
    assert not sensor.covers(np.array([(3.0, 0.0)])).any()
    count = len(bearings)
    origins, nothing = np.tile((0.2, 0.0), (count, 1)), np.zeros(count)
    scan = RangeScan(0, origins, bearings, nothing, nothing, np.full(count, math.inf), 0.05, 9.0)
    sensor.look_by_laser(0.0, scan, np.tile((3.0, -1.0, 0.5 * math.pi), (count, 1)))
    turns = np.radians([0.0, 18.0, -18.0, 24.0, -24.0, 180.0])
    places = np.column_stack([3.0 - 0.5 * np.sin(turns), -0.8 + 0.5 * np.cos(turns)])
    assert sensor.covers(places).tolist() == [True, True, True, False, False, False]
