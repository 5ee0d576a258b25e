"""The plugin: messages in, messages out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom import (
    Context,
    MapUpdate,
    OccupancyGrid,
    Path,
    PlanFailure,
    PlannerInput,
    PlanRequest,
    Pose2D,
    Registry,
    RobotSpec,
)
from navloom_astar import expansion, inflation, navloom_register, raster
from navloom_astar.adapter import AStar, Dijkstra, JumpPoint
from navloom_astar.params import AstarParams
from pydantic import ValidationError

BOX = np.array([(0.4, 0.4), (-0.4, 0.4), (-0.4, -0.4), (0.4, -0.4)])
NOTHING = np.empty((0, 4))


def make(footprint: np.ndarray = BOX, **params) -> AStar:
    robot = RobotSpec(footprint, 1.2, 0.05, 0.3, 0.5, 0.4, 0.5, 1.0)
    context = Context("main", 0.05, robot, lambda name: np.random.default_rng(0), Pose2D(0.0, 0.0, 0.0))
    return AStar(AstarParams(**params), context)


def asked(cells: np.ndarray, start, goal, resolution: float = 0.1, segments: np.ndarray = NOTHING) -> PlannerInput:
    grid = OccupancyGrid(cells.astype(np.int8), resolution, Pose2D(0.0, 0.0, 0.0))
    request = PlanRequest(7, Pose2D(*start, 0.3), Pose2D(*goal, 0.0))
    return PlannerInput(request, MapUpdate(1, grid, segments, ()))


def test_it_registers_its_planners() -> None:
    registry = Registry()
    navloom_register(registry)
    assert registry.roles == {
        ("planner", "astar"): AStar,
        ("planner", "dijkstra"): Dijkstra,
        ("planner", "jps"): JumpPoint,
    }


def test_a_path_comes_with_the_cells_where_the_robot_may_be() -> None:
    cells = np.zeros((40, 60))
    cells[20, 30] = 100
    path = make().plan(asked(cells, (1.05, 2.05), (4.95, 2.05)))
    assert isinstance(path, Path) and path.request_id == 7
    assert path.points[0].tolist() == [1.05, 2.05] and path.points[-1].tolist() == [4.95, 2.05]
    # The circumscribed radius of 0.566 m is 5.66 cells: the centres of 6 rows beside the cell's own are too near.
    assert (path.traversable.cells[:, 30] == 100).sum() == 13
    assert set(np.unique(path.traversable.cells)) == {0, 100}
    assert (path.traversable.resolution, path.traversable.origin) == (0.1, Pose2D(0.0, 0.0, 0.0))
    # 7 cells up or down in 39: 14 diagonal steps.
    assert path.length == pytest.approx(0.1 * (25 + 14 * math.sqrt(2.0)))


def test_the_inscribed_radius_may_be_chosen_and_a_margin_added() -> None:
    cells = np.zeros((40, 60))
    cells[20, 30] = 100
    given = asked(cells, (1.05, 2.05), (4.95, 2.05))
    for params, rows in (
        ({"inflation_radius": "inscribed"}, 9),  # 4 cells
        ({"inflation_radius": "inscribed", "inflation_margin": 0.1}, 11),
        ({"inflation_radius": 0.21}, 5),
        ({"inflation": "cells"}, 5),
        ({"inflation": "none"}, 1),
    ):
        traversable = make(**params).plan(given).traversable
        assert (traversable.cells[:, 30] == 100).sum() == rows, params


def test_failures_carry_kind_place_and_request() -> None:
    cells = np.zeros((10, 10))
    cells[:, 5] = 100
    failure = make(inflation="none").plan(asked(cells, (0.25, 0.25), (0.95, 0.75)))
    assert isinstance(failure, PlanFailure)
    assert (failure.request_id, failure.kind) == (7, "no_path")
    assert (failure.place.x, failure.place.y) == pytest.approx((0.45, 0.75))
    failure = make(inflation="none").plan(asked(cells, (0.25, 0.25), (9.0, 0.75)))
    assert (failure.kind, failure.place.x) == ("outside_map", 9.0)


def test_the_cell_may_be_a_third_of_the_chassis() -> None:
    wall = np.array([[1.0, -1.0, 1.0, 1.0]])
    given = asked(np.full((1, 1), -1), (0.0, 0.0), (-1.0, 0.0), segments=wall)
    assert make(cell="third_of_chassis").plan(given).traversable.resolution == pytest.approx(0.8 / 3)
    assert make().plan(given).traversable.resolution == 0.40


def test_segments_are_dilated_by_two_cells() -> None:
    wall = np.array([[2.0, 0.0, 2.0, 0.0]])
    path = make(cell=0.5).plan(asked(np.full((1, 1), -1), (0.0, 0.0), (0.5, 0.0), segments=wall))
    assert path.traversable.cells.tolist() == [[0, 0, 100, 100, 100]]


def test_t_of_the_printed_slope_test_is_the_robots_size_in_cells() -> None:
    """0.8 m are two cells: a wall along x = 2.0 m occupies all columns within two cells of it."""
    wall = np.array([[2.0, 0.0, 2.0, 0.4]])
    given = asked(np.full((1, 1), -1), (0.0, 0.0), (4.0, 0.0), segments=wall)
    for params, columns in (({}, 5), ({"paper_raster_t": 1.0}, 3)):
        failure = make(raster="paper", inflation="none", **params).plan(given)
        assert failure.kind == "no_path"
        assert failure.place.x == pytest.approx(2.0 - 0.4 * (columns // 2 + 1))


def test_by_default_an_outline_occupies_the_cells_whose_centres_it_passes() -> None:
    """y = x - 1.12 m is y = x - 2.8 cells: 0.14 cells from the centres (4, 1) to (8, 5), 0.57 from their neighbours."""
    wall = np.array([[1.6, 0.48, 3.2, 2.08]])
    path = make(inflation="none").plan(asked(np.empty((0, 0)), (0.0, 0.0), (0.4, 0.0), segments=wall))
    assert [(int(c), int(r)) for r, c in np.argwhere(path.traversable.cells)] == [
        (4, 1),
        (5, 2),
        (6, 3),
        (7, 4),
        (8, 5),
    ]


@pytest.mark.parametrize("planner", [AStar, Dijkstra, JumpPoint])
def test_all_planners_find_the_shortest_path(planner: type) -> None:
    """7 cells up or down in 39: 14 diagonal steps."""
    cells = np.zeros((40, 60))
    cells[20, 30] = 100
    robot = RobotSpec(BOX, 1.2, 0.05, 0.3, 0.5, 0.4, 0.5, 1.0)
    context = Context("main", 0.05, robot, lambda name: np.random.default_rng(0), Pose2D(0.0, 0.0, 0.0))
    path = planner(AstarParams(), context).plan(asked(cells, (1.05, 2.05), (4.95, 2.05)))
    assert path.length == pytest.approx(0.1 * (25 + 14 * math.sqrt(2.0)))


PRINTED = AStar.presets["printed"].values()


def test_as_printed_the_grid_begins_at_the_lowest_outline_and_is_dilated_by_two_cells() -> None:
    """A post at 2.1 m is a cell centre, so that centres are at 0.1 m, 0.5 m, ...; the last three cells are too near."""
    post = np.array([[2.1, 0.0, 2.1, 0.0]])
    grid = make(**PRINTED).plan(asked(np.full((1, 1), -1), (0.0, 0.0), (0.5, 0.0), segments=post)).traversable
    assert (grid.resolution, grid.origin.x) == (0.4, pytest.approx(-0.1))
    assert grid.cells.tolist() == [[0, 0, 0, 100, 100, 100]]


def test_as_printed_a_line_occupies_the_cells_whose_centres_it_passes() -> None:
    """The line of the test above, from the centre of its lowest cell on."""
    wall = np.array([[1.6, 0.4, 3.2, 2.0]])
    given = asked(np.empty((0, 0)), (0.0, 0.0), (0.4, 0.0), segments=wall + [0.0, 0.08, 0.0, 0.08])
    grid = make(**PRINTED | {"inflation": "none", "anchor": (0.0, 0.0)}).plan(given).traversable
    assert [(int(c), int(r)) for r, c in np.argwhere(grid.cells)] == [(4, 1), (5, 2), (6, 3), (7, 4), (8, 5)]


def test_as_printed_unknown_ground_is_free_and_only_outlines_are_obstacles() -> None:
    """Straight over three unknown cells, and through what the map's own cells call an obstacle."""
    cells = np.zeros((11, 11))
    cells[:2, 4:7] = -1
    cells[0, 8] = 100
    far = np.array([[4.2, 4.2, 4.2, 4.2]])
    for segments in (far, NOTHING):
        path = make(**PRINTED).plan(asked(cells, (0.2, 0.2), (4.2, 0.2), resolution=0.4, segments=segments))
        assert isinstance(path, Path) and path.length == pytest.approx(4.0)


def test_cells_are_obstacles_from_50_percent_on() -> None:
    cells = np.zeros((20, 20))
    cells[5, 5], cells[15, 15] = 49, 50
    path = make(inflation="none").plan(asked(cells, (0.05, 0.05), (1.95, 0.05)))
    assert np.argwhere(path.traversable.cells).tolist() == [[15, 15]]


def test_unknown_ground_is_free_and_costs_its_length_again_where_it_costs() -> None:
    """10 unknown cells on the way. Round them, by 20 or 28 diagonal steps, it is 8.3 or 11.6 cells farther."""
    for rows, params, is_straight in (
        (30, {}, True),
        (30, {"unknown": "cost"}, False),
        (34, {"unknown": "cost"}, True),
    ):
        cells = np.zeros((41, 41))
        cells[:rows, 15:25] = -1
        path = make(inflation="none", **params).plan(asked(cells, (0.05, 2.05), (4.05, 2.05)))
        assert bool(path.length == pytest.approx(4.0)) is is_straight, params


def test_a_gap_is_squeezed_through_with_the_inscribed_radius_and_0_05_m() -> None:
    """A gap of 19 cells in a wall: the wall begins 9.5 cells from its middle, 0.456 m or 0.442 m; 0.45 m are needed."""
    for resolution, is_passed in ((0.048, True), (0.0465, False)):
        cells = np.zeros((81, 81))
        cells[:31, 40] = cells[50:, 40] = 100
        ends = (10.5 * resolution, 40.5 * resolution), (70.5 * resolution, 40.5 * resolution)
        answer = make().plan(asked(cells, *ends, resolution=resolution))
        assert isinstance(answer, Path) is is_passed


def room_with_a_door(width: int, detour: int) -> np.ndarray:
    """(81, 121) cells of a wall in the middle, with a door `width` cells wide, and open `detour` cells from it."""
    cells = np.zeros((81, 121))
    cells[:, 58:63] = 100
    cells[20 - width // 2 : 21 + width // 2, 58:63] = 0
    cells[21 + detour :, 58:63] = 0
    return cells


@pytest.mark.parametrize("planner", [AStar, Dijkstra, JumpPoint])
def test_a_door_is_used_where_the_detour_costs_more_than_the_passage(planner: type) -> None:
    """A door of 1.1 m in a wall of 0.5 m, for a robot whose disc needs 1.13 m. Cells of 0.1 m.

    In the middle of the door, 7 cells are nearer to the posts than the disc: 5 in the wall, and one before and behind
    it, 0.552 m from the posts. The steps to the first and from the last count half, so 0.7 m cost 2.1 m more. The other
    way is 25 rows up and down, 50 diagonal steps: 2.07 m longer. With 26 rows it is 2.15 m longer.
    """
    robot = RobotSpec(BOX, 1.2, 0.05, 0.3, 0.5, 0.4, 0.5, 1.0)
    context = Context("main", 0.05, robot, lambda name: np.random.default_rng(0), Pose2D(0.0, 0.0, 0.0))
    for detour, length in ((18, 8.0 + 5.0 * (math.sqrt(2.0) - 1.0)), (19, 8.0)):
        path = planner(AstarParams(), context).plan(asked(room_with_a_door(11, detour), (2.05, 2.05), (10.05, 2.05)))
        assert path.length == pytest.approx(length), detour


def test_beside_the_way_through_a_gap_three_cells_are_left_to_smooth_it() -> None:
    """Cells of 0.02 m. The wall begins 0.55 m from the middle, so that five cells on each side are wide enough."""
    cells = np.zeros((161, 161))
    cells[:53, 80] = cells[108:, 80] = 100
    path = make().plan(asked(cells, (0.21, 1.61), (3.01, 1.61), resolution=0.02))
    assert np.flatnonzero(path.traversable.cells[:, 80] == 0).tolist() == list(range(77, 84))


def test_start_and_goal_outside_the_map_are_refused() -> None:
    failure = make(inflation="none").plan(asked(np.zeros((10, 10)), (0.05, 0.05), (1.05, 0.05)))
    assert failure.kind == "outside_map"


def test_the_grid_ends_where_its_contents_end() -> None:
    """Without a margin: the cells of the wall and of the start, 0.4 m wide."""
    wall = np.array([[2.0, 0.0, 2.0, 0.0]])
    path = make(inflation="none").plan(asked(np.empty((0, 0)), (0.0, 0.0), (0.4, 0.0), segments=wall))
    assert path.traversable.cells.shape == (1, 6)


def test_a_point_robot_is_not_inflated() -> None:
    """As `navloom plan` asks with size 0,0: a corridor one cell wide is free."""
    cells = np.full((3, 9), 100)
    cells[1] = 0
    point = 0.5e-6 * np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
    path = make(point).plan(asked(cells, (0.5, 1.5), (8.5, 1.5), resolution=1.0))
    assert path.length == pytest.approx(8.0)


def test_nothing_compiles_after_warm_up() -> None:
    AStar.warm_up()
    kernels = [
        expansion.expand,
        expansion.way_down,
        expansion.direct_way,
        expansion.set_steps,
        inflation._grow,
        raster._draw,
    ]
    before = [len(kernel.signatures) for kernel in kernels]
    cells = np.zeros((20, 20))
    cells[5:15, 10] = 100
    cells[0, 0] = -1
    wall = np.array([[1.0, 0.5, 1.0, 1.5]])
    for params in ({}, {"unknown": "cost"}, {"source": "segments", "raster": "supercover"}, {"inflation_radius": 0.3}):
        make(**params).plan(asked(cells, (0.25, 0.25), (1.75, 1.75), segments=wall))
        make(**params).plan(asked(cells, (0.25, 0.25), (1.75, 1.75)))
    assert [len(kernel.signatures) for kernel in kernels] == before == [2, 2, 2, 1, 1, 1]


@pytest.mark.parametrize(
    "params",
    [
        {"cell": 0.0},
        {"cel": 0.4},
        {"cell": "half"},
        {"inflation": "metre"},
        {"unknown_cost": 32.0},
        {"escape_start": -1.0},
    ],
)
def test_wrong_parameters_are_refused(params: dict) -> None:
    with pytest.raises(ValidationError):
        AstarParams(**params)
