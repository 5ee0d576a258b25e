import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom.geometry.grid import GridMap, world_to_grid
from navloom.geometry.world import Box, Cylinder, Place, Raster, World

BOUNDS = (0.0, 0.0, 1.0, 0.5)


def drawn(*obstacles: Box | Cylinder, raster: Raster | None = None, resolution: float = 0.1) -> list[list[int]]:
    grid = world_to_grid(World("w", obstacles, raster, bounds=BOUNDS), resolution, (0.0, 1.2))
    return [np.flatnonzero(row).tolist() for row in grid.cells == 100]


def test_a_wall_that_ends_on_a_cell_edge_fills_just_its_cells() -> None:
    assert drawn(Box("wall", (0.3, 0.5), (0.1, 0.2))) == [[], [3, 4], [], [], []]


def test_cells_covered_in_part_are_occupied() -> None:
    assert drawn(Box("wall", (0.29, 0.51), (0.15, 0.16))) == [[], [2, 3, 4, 5], [], [], []]


def test_a_turned_square_covers_a_diamond() -> None:
    # Half diagonal 0.212 round (0.45, 0.25): half width 0.062 at y = 0.1 and 0.4, 0.162 at y = 0.2 and 0.3.
    assert drawn(Box("crate", (0.30, 0.60), (0.10, 0.40), yaw=math.pi / 4)) == [
        [3, 4, 5],
        [2, 3, 4, 5, 6],
        [2, 3, 4, 5, 6],
        [2, 3, 4, 5, 6],
        [3, 4, 5],
    ]


def test_a_disc_covers_the_cells_it_reaches() -> None:
    # Round the corner of four cells, reaching 0.06 into each: along the axes, not into the next cells.
    assert drawn(Cylinder("post", 0.5, 0.2, 0.06)) == [[], [4, 5], [4, 5], [], []]
    assert drawn(Cylinder("post", 0.55, 0.25, 0.051)) == [[], [5], [4, 5, 6], [5], []]


def test_an_obstacle_partly_outside_is_cut_off() -> None:
    assert drawn(Box("wall", (-5.0, 0.15), (-1.0, 0.05)), Cylinder("far", 9.0, 9.0, 1.0)) == [[0, 1], [], [], [], []]


def test_only_obstacles_static_from_the_start_and_within_the_height_are_drawn() -> None:
    assert drawn(
        Box("girder", (0.0, 1.0), (0.0, 0.5), (1.2, 1.4)),
        Box("late", (0.0, 1.0), (0.0, 0.5), appears_at=1.0),
        Box("after sweep", (0.0, 1.0), (0.0, 0.5), appears_after_sweep=True),
        Cylinder("walker", 0.5, 0.2, 0.1, waypoints=((0.0, 0.5, 0.2),)),
    ) == [[], [], [], [], []]


def test_whole_cells_cover_the_bounds() -> None:
    grid = world_to_grid(World("w", bounds=(-1.0, -1.0, 0.05, 1.0)), 0.1, (0.0, 1.0))
    assert grid.cells.shape == (20, 11)
    assert grid.origin == Place(-1.0, -1.0)


def test_a_raster_at_the_same_cells_is_copied() -> None:
    cells = np.random.default_rng(5).random((5, 10)) < 0.4
    grid = world_to_grid(World("w", raster=Raster("r", cells, 0.1), bounds=BOUNDS), 0.1, (0.0, 1.0))
    assert np.array_equal(grid.cells == 100, cells)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32), st.floats(-3.0, 3.0), st.floats(-0.5, 0.5), st.sampled_from([0.07, 0.1, 0.23]))
def test_a_raster_covers_the_cells_that_boxes_in_its_place_cover(
    seed: int, yaw: float, offset: float, resolution: float
) -> None:
    cells = np.random.default_rng(seed).random((4, 5)) < 0.3
    boxes = []
    for row, col in np.argwhere(cells).tolist():
        u, v = (col + 0.5) * 0.1, (row + 0.5) * 0.1
        x = offset + math.cos(yaw) * u - math.sin(yaw) * v
        y = 0.2 + math.sin(yaw) * u + math.cos(yaw) * v
        boxes.append(Box(f"{row} {col}", (x - 0.05, x + 0.05), (y - 0.05, y + 0.05), yaw=yaw))
    raster = Raster("r", cells, 0.1, Place(offset, 0.2, yaw))
    assert drawn(raster=raster, resolution=resolution) == drawn(*boxes, resolution=resolution)


def test_a_coarse_raster_covers_fine_cells() -> None:
    cells = np.array([[False, True]])
    assert drawn(raster=Raster("r", cells, 0.25, Place(0.1, 0.1))) == [[], [3, 4, 5], [3, 4, 5], [3, 4, 5], []]


def test_a_grid_keeps_its_own_cells() -> None:
    cells = np.zeros((2, 3), dtype=np.int8)
    grid = GridMap(cells, 0.1)
    cells[0, 0] = 100
    assert grid.cells[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        grid.cells[0, 0] = 1


@pytest.mark.parametrize(
    ("cells", "resolution", "message"),
    [
        (np.zeros((2, 2)), 0.1, "expected int8"),
        (np.zeros(4, dtype=np.int8), 0.1, "expected int8"),
        (np.full((2, 2), 101, dtype=np.int8), 0.1, "0 to 100"),
        (np.full((2, 2), -2, dtype=np.int8), 0.1, "expected -1"),
        (np.zeros((2, 2), dtype=np.int8), 0.0, "resolution"),
        (np.zeros((2, 2), dtype=np.int8), math.nan, "resolution"),
    ],
)
def test_a_grid_of_anything_else_is_refused(cells: np.ndarray, resolution: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        GridMap(cells, resolution)


@pytest.mark.parametrize(
    ("resolution", "bounds", "message"),
    [
        (0.0, BOUNDS, "resolution"),
        (0.1, (0.0, 0.0, 0.0, 1.0), "bounds"),
        (0.1, (0.0, 0.0, math.inf, 1.0), "bounds"),
        (1e-6, BOUNDS, "make cells larger"),
    ],
)
def test_an_impossible_grid_is_refused_before_it_is_allocated(
    resolution: float, bounds: tuple[float, float, float, float], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        world_to_grid(World("w", bounds=bounds), resolution, (0.0, 1.0))
