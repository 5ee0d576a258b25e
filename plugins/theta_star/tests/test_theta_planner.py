"""The plugins: messages in, messages out, with the raster, the inflation and the failures of astar."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
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
from navloom.navigation.line_of_sight import is_segment_free
from navloom_astar.adapter import AStar
from navloom_astar.params import AstarParams
from navloom_theta_star import navloom_register, search, sight
from navloom_theta_star.adapter import LazyThetaStar, ThetaStar

BOX = np.array([(0.4, 0.4), (-0.4, 0.4), (-0.4, -0.4), (0.4, -0.4)])
NOTHING = np.empty((0, 4))
both = pytest.mark.parametrize("planner", [ThetaStar, LazyThetaStar])


def make(planner: type[AStar], **params) -> AStar:
    robot = RobotSpec(BOX, 1.2, 0.05, 0.3, 0.5, 0.4, 0.5, 1.0)
    context = Context("main", 0.05, robot, lambda name: np.random.default_rng(0), Pose2D(0.0, 0.0, 0.0))
    return planner(AstarParams(**params), context)


def asked(cells: np.ndarray, start, goal, resolution: float = 0.1, segments: np.ndarray = NOTHING) -> PlannerInput:
    grid = OccupancyGrid(cells.astype(np.int8), resolution, Pose2D(0.0, 0.0, 0.0))
    request = PlanRequest(7, Pose2D(*start, 0.3), Pose2D(*goal, 0.0))
    return PlannerInput(request, MapUpdate(1, grid, segments, ()))


def test_it_registers_both() -> None:
    registry = Registry()
    navloom_register(registry)
    assert registry.roles == {("planner", "theta_star"): ThetaStar, ("planner", "lazy_theta_star"): LazyThetaStar}


@both
def test_round_an_obstacle_by_straight_lines(planner) -> None:
    """The circumscribed radius of 5.66 cells takes 6 rows and columns beside a wall of 5 x 1 cells at row 20."""
    cells = np.zeros((60, 60))
    cells[20:25, 30] = 100
    path = make(planner).plan(asked(cells, (0.55, 2.23), (5.45, 2.23)))
    assert isinstance(path, Path) and path.request_id == 7
    assert path.points[0].tolist() == [0.55, 2.23] and path.points[-1].tolist() == [5.45, 2.23]
    assert len(path.points) <= 7  # A* has a point a cell
    assert (path.traversable.cells[:, 30] == 100).sum() == 5 + 2 * 6
    octile = make(AStar).plan(asked(cells, (0.55, 2.23), (5.45, 2.23)))
    least = 2.0 * math.hypot(2.4, 0.85 - 0.03)  # over the height of the inflation's edge at row 14
    assert least < path.length < 0.97 * octile.length
    assert path.length == pytest.approx(np.hypot(*np.diff(path.points, axis=0).T).sum())


@both
def test_no_obstacle_is_a_straight_line(planner) -> None:
    path = make(planner).plan(asked(np.zeros((50, 50)), (0.71, 0.72), (4.13, 3.9)))
    assert path.points.tolist() == [[0.71, 0.72], [4.13, 3.9]]
    assert path.length == pytest.approx(math.hypot(3.42, 3.18))


@both
@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["free", "blocked", "cost"]),
    st.sampled_from([0.05, None]),
    st.sampled_from([0.0, 0.3, 0.6]),
)
def test_failures_are_those_of_astar_and_paths_keep_to_traversable_cells(
    planner, seed: int, unknown: str, squeeze: float | None, radius: float
) -> None:
    """Every segment after the way out of the inflation is free by the framework's own line of sight."""
    rng = np.random.default_rng(seed)
    cells = rng.choice(np.array([0, 100, -1], dtype=np.int8), (40, 50), p=[0.96, 0.01, 0.03])
    start, goal = ((rng.integers((50, 40)) + 0.5) * 0.1 for _ in range(2))
    given_map = asked(cells, start.tolist(), goal.tolist())
    use = {"unknown": unknown, "squeeze_margin": squeeze, "inflation_radius": radius}
    expected, answer = (make(kind, **use).plan(given_map) for kind in (AStar, planner))
    if isinstance(expected, PlanFailure):
        assert answer == expected
        return
    assert isinstance(answer, Path)
    if unknown != "cost" and squeeze is None:
        assert answer.length <= expected.length + 1e-7
    assert answer.points[0].tolist() == start.tolist() and answer.points[-1].tolist() == goal.tolist()
    free = answer.traversable.cells == 0
    for a, b in zip(answer.points[:-1], answer.points[1:], strict=True):
        assert is_segment_free(free, 0.1, 0.0, 0.0, *a, *b), (a, b)


@both
def test_a_passage_narrower_than_the_inflation_is_used(planner) -> None:
    """A doorway of 1.1 m for a robot whose disc needs 1.13 m: 0.45 m from the centre must do."""
    cells = np.zeros((40, 60))
    cells[:, 30] = 100
    cells[15:26, 30] = 0
    path = make(planner).plan(asked(cells, (0.75, 2.05), (5.25, 2.05)))
    assert isinstance(path, Path) and path.length == pytest.approx(4.5)
    assert isinstance(make(planner, squeeze_margin=None).plan(asked(cells, (0.75, 2.05), (5.25, 2.05))), PlanFailure)


@both
def test_the_inflation_is_left_first(planner) -> None:
    """The robot is beside a wall, at a third of the radius: straight away from it, and from there in one line."""
    cells = np.zeros((60, 60))
    cells[:, 0] = 100
    path = make(planner, squeeze_margin=None).plan(asked(cells, (0.35, 3.05), (4.05, 0.95)))
    # The wall's edge is at 0.1 m, the disc's radius 0.566 m: the first free centre is at 0.75 m.
    assert path.points[:6] == pytest.approx(np.array([(0.35 + 0.1 * k, 3.05) for k in range(5)] + [(4.05, 0.95)]))


@both
def test_outlines_are_planned_on_too(planner) -> None:
    wall = np.array([[2.0, -1.0, 2.0, 1.2]])
    path = make(planner, cell=0.2, margin=2.0).plan(asked(np.full((1, 1), -1), (0, 0), (4, 0), segments=wall))
    assert isinstance(path, Path) and path.traversable.resolution == 0.2
    assert 2.0 * math.hypot(2.0, 1.2) < path.length < 2.0 * math.hypot(2.0, 2.2)


@both
def test_nothing_compiles_after_warm_up(planner) -> None:
    planner.warm_up()
    kernels = [search._search, search._take_neighbour, sight.is_in_sight, sight.ground_cost]
    before = [len(kernel.signatures) for kernel in kernels]
    cells = np.zeros((40, 40))
    cells[15:25, 20] = 100
    cells[0, 0] = -1
    for params in ({}, {"unknown": "cost"}, {"inflation_radius": 0.3}):
        make(planner, **params).plan(asked(cells, (0.75, 2.05), (3.25, 2.05)))
    assert [len(kernel.signatures) for kernel in kernels] == before
    assert before[0] == 2
