"""From maps to paths: the paper's experiment, failures with their places, unknown ground, leaving the inflation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_astar.grids import RasterMap, enlarged, grid_of_cells
from navloom_astar.inflation import disc_reach, grow
from navloom_astar.planning import Found, GoalOccupied, GridPlanner, NoPath, OutsideMap, Settings, StartOccupied

ROOT = math.sqrt(2.0)
NOTHING = np.empty((0, 4))
BLANK = RasterMap(np.full((1, 1), -1, dtype=np.int8), 0.4, (-0.2, -0.2, 0.0))
S, D = (0.0, 0.0), (0.0, 7.6)

# DECISIONS section 8: x and y intervals of obstacles between floor and robot height, m.
BOXES = {
    "back wall": ((-4.6, 7.2), (9.2, 9.4)),
    "left wall": ((-4.4, -4.2), (-1.0, 9.4)),
    "right wall": ((6.8, 7.0), (-1.0, 9.4)),
    "gate wall left": ((-4.4, -1.4), (5.2, 5.4)),
    "girder A": ((-1.4, 1.0), (5.2, 5.4)),
    "post A/B": ((1.0, 1.4), (5.2, 5.4)),
    "partition": ((3.8, 4.2), (5.2, 6.8)),
}
DOOR_B = ((1.4, 3.8), (5.2, 5.4))
DOOR_C = ((4.2, 6.8), (5.2, 5.4))


def seen_from_s(boxes: dict) -> np.ndarray:
    """(n, 4) faces that a level laser at S meets, bearings 40..140 degrees by 1, as segments from hit to hit."""
    runs: list[list[tuple[tuple, tuple[float, float]]]] = [[]]
    for bearing in np.radians(np.arange(40.0, 141.0)):
        direction = (math.cos(bearing), math.sin(bearing))
        hits = []
        for name, box in boxes.items():
            enter, leave, face = 0.0, math.inf, 0
            for axis, (low, high) in enumerate(box):
                near, far = sorted((low / direction[axis], high / direction[axis]))
                if near > enter:
                    enter, face = near, axis
                leave = min(leave, far)
            if enter < leave:
                hits.append((enter, (name, face)))
        if not hits:
            runs.append([])
            continue
        reach, key = min(hits)
        if runs[-1] and runs[-1][-1][0] != key:
            runs.append([])
        runs[-1].append((key, (reach * direction[0], reach * direction[1])))
    return np.array([(*run[0][1], *run[-1][1]) for run in runs if run])


def paper_plan(boxes: dict, **changes):
    return GridPlanner(Settings(**changes), S).plan(S, D, seen_from_s(boxes), BLANK)


def cells_of(*rows: str) -> np.ndarray:
    """(rows, columns) from a picture with the highest row first: `.` free, `#` occupied, `?` unknown."""
    table = {".": 0, "#": 100, "?": -1}
    return np.array([[table[c] for c in row] for row in reversed(rows)], dtype=np.int8)


def raster(*rows: str, resolution: float = 1.0, origin=(0.0, 0.0, 0.0)) -> RasterMap:
    return RasterMap(cells_of(*rows), resolution, origin)


def plan(given: RasterMap, start, goal, **changes):
    return GridPlanner(Settings(**changes), start).plan(start, goal, NOTHING, given)


def test_the_paper_goes_through_gate_b() -> None:
    path = paper_plan(BOXES)
    assert isinstance(path, Found)
    assert path.length == pytest.approx(10.29, abs=0.005)
    in_gate = path.points[(path.points[:, 1] > 5.1) & (path.points[:, 1] < 5.5)]
    assert len(in_gate) >= 1 and ((in_gate[:, 0] > 1.4) & (in_gate[:, 0] < 3.8)).all()


def test_without_an_anchor_cells_count_from_the_lowest_x_and_y_of_the_outlines() -> None:
    # The printed x_G = (x_L - x_min) / cellsize: outlines from (-4.2, 3.52) on, so that centres lie at -4.2 + 0.4 k.
    segments = np.array([[-4.2, 5.2, -2.0, 5.2], [-4.2, 3.52, -4.2, 5.2]])
    path = GridPlanner(Settings(), None).plan(S, D, segments, BLANK)
    assert isinstance(path, Found)
    column, row = path.grid.place((-4.2, 3.52))
    assert (column % 1.0, row % 1.0) == pytest.approx((0.5, 0.5))
    assert (path.points[1] - (-4.2, 3.52)) / 0.4 == pytest.approx(np.round((path.points[1] - (-4.2, 3.52)) / 0.4))
    assert tuple(path.points[0]) == S and tuple(path.points[-1]) == D


def test_without_the_girder_the_paper_goes_straight_through_gate_a() -> None:
    path = paper_plan({name: box for name, box in BOXES.items() if name != "girder A"})
    assert path.length == pytest.approx(7.60, abs=1e-9)
    assert path.points[:, 0] == pytest.approx(0.0, abs=1e-9)


def test_with_gate_b_blocked_the_paper_goes_through_corridor_c() -> None:
    """The sweep saw the side of the partition through the gate, and the door then closes."""
    segments = np.concatenate([seen_from_s(BOXES), [[1.4, 5.2, 3.8, 5.2]]])
    path = GridPlanner(Settings(), S).plan(S, D, segments, BLANK)
    assert path.length == pytest.approx(15.66, abs=0.005)
    assert path.points[:, 0].max() > 4.2
    # A sweep of the closed door does not see behind it, so the path cuts the partition's corner.
    assert paper_plan(BOXES | {"door B": DOOR_B}).length == pytest.approx(0.4 * (19 + 13 * ROOT), abs=1e-9)


def test_with_b_and_c_blocked_there_is_no_path_and_the_place_is_before_the_gates() -> None:
    closed = paper_plan(BOXES | {"door B": DOOR_B, "door C": DOOR_C})
    assert isinstance(closed, NoPath) and closed.kind == "no_path"
    assert closed.place == pytest.approx((0.0, 4.0))  # two cells before the wall's row at 5.2, straight below D
    assert "goal (0.00, 7.60)" in closed.detail and "(0.00, 4.00), 3.60 m away" in closed.detail


def test_start_and_goal_are_the_ends_and_steps_sum_to_the_length() -> None:
    path = paper_plan(BOXES)
    assert tuple(path.points[0]) == S and tuple(path.points[-1]) == D
    steps = np.diff(path.points, axis=0) / 0.4
    assert np.abs(steps - np.round(steps)).max() < 1e-9
    straight, diagonal = ((np.abs(np.round(steps)).sum(axis=1) == n).sum() for n in (1, 2))
    assert path.length == pytest.approx(0.4 * (straight + ROOT * diagonal), abs=1e-9)


def test_cell_centres_lie_at_the_anchor_plus_multiples_of_the_cell() -> None:
    segments = np.array([[2.0, -1.0, 2.0, 1.0]])
    planner = GridPlanner(Settings(cell=0.3, inflation="none", margin=1.0), (0.1, 0.05))
    path = planner.plan((0.1, 0.05), (4.0, 0.2), segments, BLANK)
    index = (path.points[1:-1] - (0.1, 0.05)) / 0.3
    assert np.abs(index - np.round(index)).max() < 1e-9
    assert tuple(path.points[-1]) == (4.0, 0.2)


def test_the_grid_holds_start_goal_obstacles_and_margin() -> None:
    segments = np.array([[-1.0, 2.0, 3.0, 2.0]])
    for margin, x, shape in ((0.0, -1.5, (3, 5)), (2.0, -3.5, (7, 9))):  # x -1..3, y 0..2, cells of 1 m
        grid = (
            GridPlanner(Settings(cell=1.0, margin=margin, inflation="none"), S)
            .plan(S, (2.0, 0.0), segments, BLANK)
            .grid
        )
        assert grid.occupied.shape == shape and grid.origin == (x, x + 1.0, 0.0)


def test_typed_failures_name_the_place() -> None:
    given = raster("....", ".##.", "....")
    assert plan(given, (0.5, 0.5), (2.5, 1.5)) == GoalOccupied((2.5, 1.5), "the goal (2.50, 1.50) is in an obstacle")
    assert plan(given, (1.5, 1.5), (0.5, 0.5)) == StartOccupied((1.5, 1.5), "the start (1.50, 1.50) is in an obstacle")
    assert (GoalOccupied.kind, StartOccupied.kind, NoPath.kind) == ("goal_occupied", "start_occupied", "no_path")
    outside = plan(given, (0.5, 0.5), (4.5, 0.5))
    assert outside == OutsideMap((4.5, 0.5), "the goal (4.50, 0.50) is outside the map")
    assert plan(given, (0.5, -0.1), (0.5, 0.5)).kind == "outside_map"
    closed = plan(raster(".#..", ".#..", ".#.."), (0.5, 0.5), (3.5, 1.5))
    assert isinstance(closed, NoPath) and closed.place == (0.5, 1.5)
    tight = plan(given, (0.5, 0.5), (3.5, 1.5), radius=0.6)
    assert tight == GoalOccupied((3.5, 1.5), "the goal (3.50, 1.50) is too near to an obstacle for the robot")


def test_a_goal_at_the_end_of_the_world_is_outside_the_map() -> None:
    far = GridPlanner(Settings(), S).plan(S, (1e6, 1e6), np.array([[1.0, 1.0, 2.0, 1.0]]), BLANK)
    assert isinstance(far, OutsideMap) and far.place == (1e6, 1e6)


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_a_map_can_be_enlarged_by_unknown_cells_to_hold_an_unseen_goal(heading):
    """A wall across the end of a map of 2 x 3 m: with a margin round the map there is a path past it, else none."""
    cells = np.zeros((6, 4), dtype=np.int8)
    cells[5] = 100
    frame = RasterMap(cells, 0.5, (1.0, 2.0, heading))
    cos, sin = math.cos(heading), math.sin(heading)

    def at(along, across):
        return 1.0 + cos * along - sin * across, 2.0 + sin * along + cos * across

    start, goal = at(1.0, 0.25), at(1.0, 5.0)
    settings = {"inflation": "none", "outside": "unknown"}
    found = GridPlanner(Settings(**settings, margin=1.0), (0.0, 0.0)).plan(start, goal, NOTHING, frame)
    assert isinstance(found, Found) and np.allclose(found.points[[0, -1]], [start, goal])
    assert 4.75 + 0.5 < found.length < 4.75 + 3.0
    beside = np.hypot(*(found.points - at(-0.25, 2.75)).T).min(), np.hypot(*(found.points - at(2.25, 2.75)).T).min()
    assert min(beside) < 1e-9  # past one end of the wall
    assert isinstance(GridPlanner(Settings(**settings), (0.0, 0.0)).plan(start, goal, NOTHING, frame), NoPath)
    far = GridPlanner(Settings(**settings), (0.0, 0.0)).plan(start, (1e5, 1e5), NOTHING, frame)
    assert isinstance(far, OutsideMap)


def test_a_map_grows_to_16_million_cells_and_no_further() -> None:
    """One row of cells of 1 m: the point 15 999 999.5 m along it is in its 16 millionth cell."""
    row = grid_of_cells(raster("."), 50)
    longest = enlarged(row, ((15_999_999.5, 0.5),), 0.0)
    assert longest is not None and longest.occupied.shape == (1, 16_000_000)
    assert enlarged(row, ((16_000_000.5, 0.5),), 0.0) is None


def test_a_billionth_of_a_cell_beyond_the_edge_is_rounding() -> None:
    grid = grid_of_cells(raster("...", "..."), 50)
    assert [grid.cell_at((x, 1.0)) for x in (-1.2e-9, -0.9e-9, 3.0 + 0.9e-9, 3.0 + 1.2e-9)] == [
        None, (1, 0), (1, 2), None,
    ]  # fmt: skip


def test_the_outer_edge_belongs_to_the_map() -> None:
    path = plan(raster("...", "..."), (0.0, 0.0), (3.0, 2.0))
    assert path.points.tolist()[0] == [0.0, 0.0] and path.points.tolist()[-1] == [3.0, 2.0]


def test_a_turned_map_is_planned_on_in_its_own_cells() -> None:
    """Turned a quarter left round (10, 20): column 3 lies at y = 23.5."""
    given = raster(".#..", ".#..", "....", origin=(10.0, 20.0, math.pi / 2))
    path = plan(given, (7.5, 20.5), (7.5, 22.5))  # row 2, columns 0 and 2
    assert path.length == pytest.approx(6.0)  # down two rows, two columns along, up two rows
    assert path.points[2] == pytest.approx((9.5, 20.5))
    assert path.grid.origin == (10.0, 20.0, math.pi / 2)


def test_auto_uses_segments_if_there_are_any() -> None:
    given = raster("....", "....")
    assert plan(given, (0.5, 0.5), (3.5, 0.5)).grid.resolution == 1.0
    planner = GridPlanner(Settings(cell=0.25), (0.5, 0.5))
    assert planner.plan((0.5, 0.5), (3.5, 0.5), np.array([[0.0, 5.0, 3.0, 5.0]]), given).grid.resolution == 0.25
    only_cells = GridPlanner(Settings(source="cells"), (0.5, 0.5))
    assert only_cells.plan((0.5, 0.5), (3.5, 0.5), np.array([[0.0, 5.0, 3.0, 5.0]]), given).grid.resolution == 1.0


@pytest.mark.parametrize(
    ("unknown", "cost", "length"),
    [
        ("free", 1.0, 4.0),
        ("blocked", 1.0, 2 + 4 + 2),  # down, along, up: corners of obstacles are not cut
        ("cost", 0.25, 4.0),  # costs 1.125 + 1.25 + 1.25 + 1.125 = 4.75
        ("cost", 2.0, 4 + 2 * ROOT),  # straight on would cost 10; corners of unknown ground may be cut
    ],
)
def test_unknown_ground(unknown: str, cost: float, length: float) -> None:
    given = raster(".???.", ".???.", ".....")
    path = plan(given, (0.5, 2.5), (4.5, 2.5), unknown=unknown, unknown_cost=cost)
    assert path.length == pytest.approx(length)


def test_unknown_is_read_from_the_map_when_planning_on_segments() -> None:
    """A map of 1 m cells whose middle is unknown; the grid of segments has cells of 0.5 m."""
    given = raster("....", ".??.", "....")
    segments = np.array([[0.25, 2.75, 0.25, 2.75]])
    planner = GridPlanner(Settings(cell=0.5, unknown="blocked", inflation="none"), (0.25, 0.25))
    path = planner.plan((0.25, 0.25), (3.75, 2.75), segments, given)
    expected = np.zeros((6, 8), dtype=np.bool_)
    expected[2:4, 2:6] = True
    assert (path.grid.unknown == expected).all()
    expected[5, 0] = True
    assert (path.traversable == ~expected).all()


def test_occupied_from_tells_obstacles() -> None:
    given = RasterMap(np.array([[0, 49, 0]], dtype=np.int8), 1.0, (0.0, 0.0, 0.0))
    assert isinstance(plan(given, (0.5, 0.5), (2.5, 0.5)), Found)
    assert isinstance(plan(given, (0.5, 0.5), (2.5, 0.5), occupied_from=49), NoPath)


def test_inflation_by_metres_takes_the_resolution_into_account() -> None:
    """Radius 0.3 m in cells of 0.1 m: centres nearer than 3 cells to the wall's edge, which are the next 3."""
    given = raster(*["#" + "." * 9] * 3, resolution=0.1)
    path = plan(given, (0.65, 0.05), (0.95, 0.25), radius=0.3)
    assert path.traversable.tolist() == [[False] * 4 + [True] * 6] * 3


def test_the_robot_may_leave_the_inflation_but_no_obstacle() -> None:
    """Radius 2.2 cells: the columns 1 and 2 beside the wall are too near, and are left straight away from it."""
    given = raster(*["#........."] * 5)
    start, goal = (1.5, 2.5), (8.5, 2.5)
    path = plan(given, start, goal, radius=2.2)
    assert path.length == pytest.approx(7.0)
    assert path.points[:, 1] == pytest.approx(2.5)
    assert np.argwhere(path.traversable[:, :3]).tolist() == [[2, 1], [2, 2]]  # opened only for the way out
    assert isinstance(plan(given, start, goal, radius=2.2, escape=0.0), StartOccupied)
    assert isinstance(plan(given, start, goal, radius=2.2, escape=1.9), StartOccupied)
    assert plan(given, start, goal, radius=2.2, escape=2.0).length == pytest.approx(7.0)
    assert plan(given, (0.5, 2.5), goal, radius=2.2).detail == "the start (0.50, 2.50) is in an obstacle"


def test_the_robot_finds_the_way_out_of_a_corner() -> None:
    """Radius 4.2 cells beside two walls: five cells along the diagonal."""
    given = raster(*["#..........."] * 11, "#" * 12)
    path = plan(given, (1.5, 1.5), (10.5, 10.5), radius=4.2)
    assert path.length == pytest.approx(9 * ROOT)
    assert not path.traversable[1:5, 1:5].all() and path.traversable[1:5, 1:5].trace() == 4


def test_the_way_out_is_to_the_side_of_the_goal() -> None:
    """The robot is in a doorway too narrow for it: either side is two cells away."""
    side, wall = ["#.....#...#"] * 2, "###########"
    given = raster(wall, *side, "#.........#", *side, wall)
    for goal_x in (3.5, 8.5):
        path = plan(given, (6.5, 3.5), (goal_x, 3.5), radius=1.0)
        assert path.points[0].tolist() == [6.5, 3.5]
        assert path.length == pytest.approx(abs(goal_x - 6.5))
    # From beside it, one cell within the left room, the far side is three cells away and the way leads through it.
    assert isinstance(plan(given, (5.5, 3.5), (8.5, 3.5), radius=1.0, escape=2.0), NoPath)


def test_start_and_goal_in_one_cell() -> None:
    path = plan(raster(".."), (0.2, 0.5), (0.7, 0.5))
    assert path.points.tolist() == [[0.2, 0.5], [0.7, 0.5]] and path.length == pytest.approx(0.5)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 2.5), st.integers(0, 3))
def test_paths_keep_to_traversable_cells_off_the_start(seed: int, radius: float, turns: int) -> None:
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((25, 30)) < 0.04, 100, 0).astype(np.int8)
    given = RasterMap(cells, 1.0, (0.0, 0.0, turns * math.pi / 2))
    planner = GridPlanner(Settings(radius=radius), S)
    answer = planner.plan(*_two_free(given, rng), NOTHING, given)
    if not isinstance(answer, Found):
        assert answer.kind in ("start_occupied", "goal_occupied", "no_path")
        return
    columns, rows = np.floor(answer.grid.places(answer.points)).astype(int).T
    assert answer.traversable[rows, columns].all()
    assert answer.traversable[rows[1:], columns[:-1]].all() and answer.traversable[rows[:-1], columns[1:]].all()
    clear = ~grow(cells >= 50, disc_reach(radius))
    outside = np.flatnonzero(clear[rows, columns])
    assert clear[rows, columns][outside[0] :].all()  # once out of the inflation, it never enters it again
    assert not (cells[rows, columns] >= 50).any()
    assert answer.length == pytest.approx(np.hypot(*np.diff(answer.points, axis=0).T).sum())


def _two_free(given: RasterMap, rng: np.random.Generator) -> list[tuple[float, float]]:
    cells = np.argwhere(given.cells == 0)
    chosen = cells[rng.integers(len(cells), size=2)]
    return [tuple(point) for point in grid_of_cells(given, 50).centres(chosen).tolist()]


def test_the_same_request_gives_the_same_answer() -> None:
    rng = np.random.default_rng(8)
    given = RasterMap(np.where(rng.random((60, 60)) < 0.2, 100, 0).astype(np.int8), 1.0, (0.0, 0.0, 0.0))
    start, goal = _two_free(given, rng)
    planner = GridPlanner(Settings(), S)
    answers = [planner.plan(start, goal, NOTHING, given) for _ in range(3)]
    assert isinstance(answers[0], Found)
    assert all(each.points.tolist() == answers[0].points.tolist() for each in answers)
