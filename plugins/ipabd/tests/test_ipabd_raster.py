"""Cells of segments, and cells that rays passed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_ipabd.errors import SettingError
from navloom_ipabd.lines import distances_to_segments
from navloom_ipabd.mapping import Outline, _extent_of
from navloom_ipabd.pressure import Barriers, Bins
from navloom_ipabd.raster import Lattice, mark_occupied, mark_seen, merge_cells, move_cells

UNIT = Lattice.covering((0.0, 0.0, 4.0, 3.0), 1.0, (0.0, 0.0))


def drawn(
    segments: list[list[float]], method: str = "distance", lattice: Lattice = UNIT, paper_t: float = 0.8
) -> list[list[int]]:
    cells = lattice.unknown()
    mark_occupied(cells, lattice, np.array(segments), method, paper_t)
    return [[int(column), int(row)] for row, column in np.argwhere(cells == 100)]


def centres(lattice: Lattice) -> np.ndarray:
    rows, columns = np.mgrid[: lattice.rows, : lattice.columns]
    x = lattice.origin[0] + (columns + 0.5) * lattice.resolution
    y = lattice.origin[1] + (rows + 0.5) * lattice.resolution
    return np.stack([x, y], axis=-1)


def test_centres_lie_at_the_anchor_plus_multiples() -> None:
    lattice = Lattice.covering((-1.0, 0.1, 1.0, 2.0), 0.4, (0.05, 0.1))
    assert lattice.origin == pytest.approx((-1.35, -0.1))  # centres at 0.05 - 3 * 0.4 = -1.15 and at 0.1
    assert (lattice.rows, lattice.columns) == (6, 6)  # y 0.1 .. 2.1, x -1.15 .. 0.85


def test_row_0_has_the_lowest_y() -> None:
    assert drawn([[1.0, 0.0, 3.0, 0.0]]) == [[1, 0], [2, 0], [3, 0]]


def test_a_vertical_and_a_diagonal_line() -> None:
    assert drawn([[2.0, 0.0, 2.0, 3.0]]) == [[2, 0], [2, 1], [2, 2], [2, 3]]
    assert drawn([[0.0, 0.0, 3.0, 3.0]]) == [[0, 0], [1, 1], [2, 2], [3, 3]]


def test_a_post_between_four_centres_is_not_lost() -> None:
    assert drawn([[1.45, 1.45, 1.45, 1.45]]) == [[1, 1]]  # 0.64 cells from its centre, more than half a cell


def test_supercover_takes_the_corners_that_distance_leaves() -> None:
    # y = x + 0.2 passes (k, k) at 0.14 cells and (k, k + 1) at 0.57: through a corner of it, farther than half a cell.
    line = [[0.0, 0.2, 3.0, 3.2]]
    assert drawn(line) == [[0, 0], [1, 1], [2, 2], [3, 3]]
    assert drawn(line, "supercover") == [[0, 0], [0, 1], [1, 1], [1, 2], [2, 2], [2, 3], [3, 3]]


def test_the_printed_test_does_not_end_with_the_segment() -> None:
    inside = [[1.0, 1.0, 1.0, 2.0]]
    assert drawn(inside) == [[1, 1], [1, 2]]
    printed = drawn(inside, "paper")  # |m - 1| <= 0.8 over all rows
    assert printed == [[1, 0], [1, 1], [1, 2], [1, 3]]


def test_the_printed_test_survives_horizontal_lines() -> None:
    assert drawn([[1.0, 2.0, 2.0, 2.0]], "paper") == [[0, 2], [1, 2], [2, 2], [3, 2], [4, 2]]


def test_t_of_the_printed_slope_test() -> None:
    """From (0, 0) to (3, 2) the slope is 1.5: |m / n - 1.5| <= T. In row 1 that takes m = 1 and 2 from T = 0.5 on, in
    row 2 m = 3 at once and 2 and 4 from T = 0.5 on, in row 3 m = 4 from T = 0.17 on and m = 3 from T = 0.5 on."""
    line = [[0.0, 0.0, 3.0, 2.0]]
    assert [cell for cell in drawn(line, "paper", paper_t=0.2) if cell[1]] == [[3, 2], [4, 3]]
    assert [cell for cell in drawn(line, "paper", paper_t=0.5) if cell[1]] == [
        [1, 1], [2, 1], [2, 2], [3, 2], [4, 2], [3, 3], [4, 3],
    ]  # fmt: skip


def test_segments_outside_of_the_lattice_are_left_out() -> None:
    assert drawn([[-9.0, -9.0, -5.0, -9.0], [3.0, 3.0, 9.0, 3.0]]) == [[3, 3], [4, 3]]


@settings(max_examples=60, deadline=None)
@given(st.tuples(*[st.floats(-0.4, 3.4)] * 4))
def test_distance_is_exactly_half_a_cell_or_an_end(ends: tuple[float, ...]) -> None:
    segment = np.array([ends])
    cells = UNIT.unknown()
    mark_occupied(cells, UNIT, segment)
    gaps = distances_to_segments(centres(UNIT).reshape(-1, 2), segment).reshape(cells.shape)
    is_end = np.zeros(cells.shape, dtype=bool)
    for x, y in segment.reshape(2, 2):
        is_end[math.floor(y + 0.5), math.floor(x + 0.5)] = True
    sure = np.abs(gaps - 0.5) > 1e-9
    assert ((cells == 100) == ((gaps <= 0.5) | is_end))[sure].all()


@settings(max_examples=60, deadline=None)
@given(st.tuples(*[st.floats(-0.4, 3.4)] * 4))
def test_supercover_holds_every_point_of_the_segment(ends: tuple[float, ...]) -> None:
    cells = UNIT.unknown()
    mark_occupied(cells, UNIT, np.array([ends]), "supercover")
    share = np.linspace(0.0, 1.0, 97)[:, None]
    points = (1.0 - share) * ends[:2] + share * ends[2:]
    columns, rows = np.floor(points.T + 0.5).astype(int)
    assert (cells[rows, columns] == 100).all()


def test_free_where_a_ray_passed_and_unknown_elsewhere() -> None:
    lattice = Lattice.covering((-1.0, -1.0, 4.0, 1.0), 1.0, (0.0, 0.0))
    cells = lattice.unknown()
    bins = Bins(math.radians(-10.0), math.radians(10.0), 3)  # -15° .. 15°
    mark_seen(cells, lattice, (0.0, 0.0, 0.0), bins, np.array([2.5, 2.5, 0.0]))
    assert [[int(c), int(r)] for r, c in np.argwhere(cells == 0)] == [[1, 1], [2, 1], [3, 1]]
    assert (cells == -1).sum() == 15


def test_seen_turns_with_the_robot() -> None:
    lattice = Lattice.covering((-1.0, -1.0, 1.0, 4.0), 1.0, (0.0, 0.0))
    cells = lattice.unknown()
    mark_seen(cells, lattice, (0.0, 0.0, math.pi / 2), Bins(0.0, math.radians(10.0), 1), np.array([2.5]))
    assert [[int(c), int(r)] for r, c in np.argwhere(cells == 0)] == [[1, 1], [1, 2], [1, 3]]


def seen_cells(sensor: tuple[float, float], bearing_deg: float, width_deg: float, seen: float) -> list[list[int]]:
    """Free cells, column and row, of a lattice from (0, 0) to (3, 3) whose cells of 1 m are centred on whole metres."""
    lattice = Lattice.covering((0.0, 0.0, 3.0, 3.0), 1.0, (0.0, 0.0))
    cells = lattice.unknown()
    bins = Bins(math.radians(bearing_deg), math.radians(width_deg), 1)
    mark_seen(cells, lattice, (*sensor, 0.0), bins, np.array([seen]))
    return [[int(column), int(row)] for row, column in np.argwhere(cells == 0)]


def test_a_cell_whose_centre_is_as_far_as_the_ray_was_seen_is_not_free() -> None:
    assert seen_cells((0.0, 0.0), 0.0, 10.0, seen=2.0) == [[0, 0], [1, 0]]
    assert seen_cells((0.0, 0.0), 0.0, 10.0, seen=2.1) == [[0, 0], [1, 0], [2, 0]]


def test_the_distance_of_a_cell_counts_along_its_diagonal() -> None:
    """Between 15 and 75 degrees, (1, 1) is 1.41 m away, (2, 1) and (1, 2) 2.24 m, and (2, 2) 2.83 m."""
    assert seen_cells((0.0, 0.0), 45.0, 60.0, seen=2.5) == [[0, 0], [1, 1], [2, 1], [1, 2]]


@pytest.mark.parametrize(
    ("sensor", "own"),
    [
        ((1.4, 1.0), [[1, 1]]),
        ((1.0, 1.4), [[1, 1]]),
        ((1.5, 1.0), [[1, 1], [2, 1]]),
        ((1.0, 1.5), [[1, 1], [1, 2]]),
    ],
)
def test_the_cell_of_the_sensor_is_free_and_on_an_edge_both_are(sensor, own) -> None:
    assert seen_cells(sensor, 0.0, 10.0, seen=0.0) == own


def test_moving_to_another_lattice_keeps_places() -> None:
    small = Lattice.covering((1.0, 1.0, 2.0, 2.0), 1.0, (0.0, 0.0))
    cells = np.array([[0, 100], [-1, 0]], dtype=np.int8)
    moved = move_cells(cells, small, UNIT)
    assert (int(moved[1, 1]), int(moved[1, 2]), int(moved[2, 2])) == (0, 100, 0)
    assert (moved == -1).sum() == 20 - 3
    assert move_cells(moved, UNIT, small).tolist() == cells.tolist()


def test_merged_occupied_wins_over_free_over_unknown() -> None:
    old, new = np.array([[100, 100, 0, -1]], dtype=np.int8), np.array([[0, -1, -1, -1]], dtype=np.int8)
    assert merge_cells(old, new).tolist() == [[100, 100, 0, -1]]


def test_a_map_of_too_many_cells_is_refused() -> None:
    with pytest.raises(SettingError, match="enlarge the cells"):
        Lattice.covering((0.0, 0.0, 1000.0, 1000.0), 0.01, (0.0, 0.0))
    with pytest.raises(SettingError, match="low <= high"):
        Lattice.covering((1.0, 0.0, 0.0, 1.0), 0.4, (0.0, 0.0))


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(SettingError, match="'distance', 'supercover' or 'paper'"):
        drawn([[0.0, 0.0, 1.0, 1.0]], "slope")


@pytest.mark.parametrize(
    ("anchor", "sensor", "segment", "seen", "extent"),
    [
        ((-5.0, 7.0), (0.1, -0.1, 0.0), [0.2, 0.3, -0.2, -0.3], 0.0, (-5.0, -0.3, 0.2, 7.0)),
        ((0.0, 0.0), (4.0, -6.0, 0.0), [0.2, 0.3, -0.2, -0.3], 0.0, (-0.2, -6.0, 4.0, 0.3)),
        ((0.0, 0.0), (0.1, -0.1, 0.0), [9.0, -8.0, -0.2, 0.3], 0.0, (-0.2, -8.0, 9.0, 0.3)),
        ((0.0, 0.0), (0.1, -0.1, 0.0), [0.2, 0.3, -7.0, 6.0], 0.0, (-7.0, -0.1, 0.2, 6.0)),
        ((0.0, 0.0), (0.1, -0.1, math.pi / 2), [0.2, 0.3, -0.2, -0.3], 5.0, (-0.2, -0.3, 0.2, 4.9)),
        ((0.0, 0.0), (0.1, -0.1, 0.0), [0.2, 0.3, -0.2, -0.3], 5.0, (-0.2, -0.3, 5.1, 0.3)),
    ],
    ids=["anchor", "sensor", "first end", "second end", "seen ahead", "seen along x"],
)
def test_the_map_holds_anchor_sensor_segments_and_what_was_seen(anchor, sensor, segment, seen, extent) -> None:
    bins = Bins(0.0, math.radians(1.0), 1)
    barriers = Barriers(bins, np.array([math.inf]), np.full((1, 3), math.nan), np.array([seen]), {})
    shown = Outline(np.array([segment]), sensor, barriers)
    assert _extent_of(shown, np.array([seen]), anchor) == pytest.approx(extent)
