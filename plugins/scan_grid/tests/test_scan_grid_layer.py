"""The layer of seen obstacles over a known map, and its mapper. Cells of 0.1 m; the robot is in the middle of one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom import Context, MapperInput, OccupancyGrid, Pose2D, PoseTrack, RangeScan, RobotSpec
from navloom_scan_grid.adapter import Layered
from navloom_scan_grid.layer import LayerSettings, ObstacleLayer, ends_beyond, near_walls, outside
from navloom_scan_grid.mapping import Beams
from navloom_scan_grid.params import LayeredParams
from numpy.typing import NDArray

CELL = 0.1
SQUARE = np.array([[0.25, 0.25], [-0.25, 0.25], [-0.25, -0.25], [0.25, -0.25]])
ROBOT = RobotSpec(SQUARE, 0.6, 0.05, 0.2, 0.5, 1.0, 0.5, 1.0)
HERE = (1.05, 2.05, 0.0)
TICK_NS = 50_000_000


def empty() -> NDArray[np.int8]:
    return np.zeros((40, 40), np.int8)


def walled() -> NDArray[np.int8]:
    """A wall in the cells from x = 3.0 to 3.1 m."""
    cells = empty()
    cells[:, 30] = 100
    return cells


def layer(
    known: NDArray[np.int8], origin: tuple[float, float, float] = (0.0, 0.0, 0.0), **settings: float
) -> ObstacleLayer:
    return ObstacleLayer(known, CELL, origin, HERE[:2], LayerSettings(**settings))


def look(
    at: ObstacleLayer, reading: float, half_angle: float = 0.0, pose: tuple[float, ...] = HERE, sensor: str = "front"
) -> None:
    """One reading straight ahead, of a beam or a cone."""
    one = np.zeros(1)
    beam = Beams(0, np.zeros((1, 2)), one, one + half_angle, one, one + reading, 0.05, 8.0)
    at.insert(sensor, beam, np.zeros(1, np.int64), np.array([pose]))


def marked(at: ObstacleLayer) -> list[tuple[int, int]]:
    """Row and column of every cell that the layer adds."""
    return [tuple(cell) for cell in np.argwhere(at.cells() != at.known).tolist()]


def test_an_echo_in_mapped_free_space_is_marked() -> None:
    seen = layer(empty())
    look(seen, 1.0)
    assert marked(seen) == [(20, 20)] and seen.cells()[20, 20] == 100


@pytest.mark.parametrize("margin, cells", [(0.2, []), (0.1, [(20, 28)])])
def test_an_echo_within_the_margin_of_a_mapped_wall_is_that_wall(margin: float, cells: list[tuple[int, int]]) -> None:
    """The echo is in column 28, two cells before the wall."""
    seen = layer(walled(), wall_margin=margin)
    look(seen, 1.8)
    assert marked(seen) == cells


def test_an_echo_of_a_mapped_wall_clears_the_way_to_it() -> None:
    seen = layer(walled())
    look(seen, 1.0)
    look(seen, 1.95)
    assert marked(seen) == []


def test_a_sonars_arc_that_reaches_a_mapped_wall_marks_nothing() -> None:
    """At 15° to the side, an arc of 1.95 m is 0.5 m to the side: there a wall is mapped, ahead none."""
    known = empty()
    known[25, 29] = 100
    seen = layer(known, wall_margin=0.1)
    for _ in range(3):
        look(seen, 1.95, math.radians(15.0))
    assert marked(seen) == []
    seen = layer(empty())
    for _ in range(3):
        look(seen, 1.95, math.radians(15.0))
    assert (20, 30) in marked(seen)


def test_an_obstacle_seen_for_long_is_gone_after_eight_beams_through_it() -> None:
    """ln(0.97 / 0.03) = 3.48, ln(0.4 / 0.6) = -0.41, ln(0.65 / 0.35) = 0.62: 3.48 - 7 * 0.41 = 0.64, 8 give 0.23."""
    seen = layer(empty())
    for _ in range(20):
        look(seen, 1.0)
    for _ in range(7):
        look(seen, 2.5)
    assert (20, 20) in marked(seen)
    look(seen, 2.5)
    assert (20, 20) not in marked(seen)


def test_a_mapped_wall_is_never_cleared() -> None:
    seen = layer(walled())
    for _ in range(20):
        look(seen, 2.8)
    assert (seen.cells()[:, 30] == 100).all()


@pytest.mark.parametrize("duration, stays", [(59.0, True), (61.0, False)])
def test_an_obstacle_seen_for_long_is_forgotten_after_the_memory(duration: float, stays: bool) -> None:
    seen = layer(empty(), memory=60.0)
    for _ in range(20):
        look(seen, 1.0)
    for _ in range(10):
        seen.fade(0.1 * duration)
    assert bool(marked(seen)) is stays


def test_without_a_limit_of_memory_it_stays() -> None:
    seen = layer(empty())
    look(seen, 1.0)
    seen.fade(1e9)
    assert marked(seen) == [(20, 20)]


def test_cleared_it_keeps_what_the_newest_scan_of_each_sensor_shows() -> None:
    seen = layer(empty())
    for _ in range(3):
        look(seen, 0.5)
    look(seen, 1.0)
    look(seen, 1.0, pose=(1.05, 3.05, 0.0), sensor="rear")
    assert marked(seen) == [(20, 15), (20, 20), (30, 20)]
    seen.clear()
    assert marked(seen) == [(20, 20), (30, 20)]


def test_the_cells_are_those_of_a_turned_map() -> None:
    """The map begins at (5, 1) and is turned by 90°: its columns run along y. Base at (2.95, 2.05) looks along y."""
    seen = ObstacleLayer(empty(), CELL, (5.0, 1.0, math.pi / 2), (2.95, 2.05), LayerSettings())
    look(seen, 1.0, pose=(2.95, 2.05, math.pi / 2))
    assert marked(seen) == [(20, 20)]


def test_what_is_beyond_the_map_is_left_out() -> None:
    seen = layer(empty())
    look(seen, 5.0)
    assert seen.cells().shape == (40, 40) and marked(seen) == []


def test_cells_near_walls_are_within_a_disc() -> None:
    walls = np.zeros((5, 5), np.bool_)
    walls[2, 2] = True
    assert near_walls(walls, 1.0).sum() == 5 and near_walls(walls, 1.5).sum() == 9 and near_walls(walls, 0.0).sum() == 1


def test_the_robots_own_body_ends_a_margin_beside_its_footprint() -> None:
    points = np.array([[0.0, 0.0], [0.26, 0.1], [0.28, 0.1], [-0.24, -0.24], [0.0, -0.3]])
    assert outside(points, SQUARE, 0.02).tolist() == [False, False, True, False, True]


# --- the mapper -----------------------------------------------------------------------------------------------------


def mapper(known: NDArray[np.int8] | None = None, **params: object) -> Layered:
    grid = OccupancyGrid(empty() if known is None else known, CELL, Pose2D(0.0, 0.0, 0.0))
    return Layered(
        LayeredParams(**params), Context("main", 0.05, ROBOT, np.random.default_rng, Pose2D(*HERE), map=grid)
    )


def given(tick: int, *readings: float, clear: bool = False, is_tracking: bool = True) -> MapperInput:
    """A scan of a beam straight ahead, 0.1 m from the base, for each reading."""
    stamps = TICK_NS * np.arange(tick + 1)
    one, mount = np.zeros(1), np.array([[0.1, 0.0]])
    scans = tuple(RangeScan(TICK_NS * tick, mount, one, one, one, one + reading, 0.05, 8.0) for reading in readings)
    track = PoseTrack(stamps, np.tile(HERE, (tick + 1, 1)))
    return MapperInput(TICK_NS * tick, (), scans, track, clear, is_tracking=is_tracking)


def test_the_known_map_is_published_before_the_first_scan() -> None:
    first = mapper(walled()).update(given(0))
    assert first is not None and np.array_equal(first.grid.cells, walled()) and first.segments.shape == (0, 4)


def test_a_new_obstacle_is_published_at_the_rate_and_only_if_cells_changed() -> None:
    tried = mapper(publish_rate_hz=1.0)
    tried.update(given(0))
    assert [tick for tick in range(1, 60) if tried.update(given(tick, 0.9)) is not None] == [20]


def test_the_known_map_stays_as_it_was() -> None:
    tried = mapper(walled())
    tried.update(given(0, 0.9))
    assert tried.known() is tried.known() and np.array_equal(tried.known().cells, walled())


def test_an_echo_of_the_robot_itself_is_not_marked() -> None:
    """The beam begins 0.1 m before the base: 0.16 m ends within the footprint of 0.25 m, 0.4 m does not."""
    for reading, count in ((0.16, 0), (0.4, 1)):
        update = mapper().update(given(0, reading))
        assert update is not None and int((update.grid.cells == 100).sum()) == count


def test_while_the_localizer_is_not_tracking_nothing_is_marked() -> None:
    update = mapper().update(given(0, 0.9, is_tracking=False))
    assert update is not None and not update.grid.cells.any()


def test_a_clear_request_is_answered_at_once_with_what_is_seen_now() -> None:
    tried = mapper()
    tried.update(given(0, 0.9))
    update = tried.update(given(1, clear=True))
    assert update is not None and update.stamp_ns == TICK_NS and update.grid.cells[20, 20] == 100


def test_beams_that_all_end_beyond_the_body_need_no_look_at_each() -> None:
    """A square of 1 m: 0.5 m to a side, 0.7071 m to a corner, so 0.7354 m with a margin of 2 cm."""
    radii, ahead = (0.5, math.sqrt(0.5)), np.array([[0.1, 0.0]])
    for length, beyond in ((0.83, False), (0.84, True), (math.inf, True)):
        assert ends_beyond(ahead, np.array([length]), radii, 0.02) is beyond
    assert not ends_beyond(ahead, np.array([9.0]), (-0.1, 0.7), 0.02)


def test_what_ends_beyond_is_outside() -> None:
    """A thin triangle, whose sides meet far out when they are moved: every beam near it is looked at."""
    thin = np.array([[2.0, 0.0], [-0.1, 0.1], [-0.1, -0.1]])
    inner, outer = 0.2 / math.hypot(2.1, 0.1), 2.0
    draw = np.random.default_rng(1)
    for _ in range(200):
        angle, length = draw.uniform(-0.2, 0.2), draw.uniform(1.9, 3.0)
        origin = np.zeros((1, 2))
        if ends_beyond(origin, np.array([length]), (inner, outer), 0.05):
            assert outside(length * np.array([[math.cos(angle), math.sin(angle)]]), thin, 0.05).all()
