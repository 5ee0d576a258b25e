"""The footprint's test against the grid: distances worked by hand, and a slow reader of every pose and cell."""

import math

import numpy as np
import pytest
from navloom_hybrid_astar.clearance import (
    SWEEP,
    advanced,
    body_of,
    ground_of,
    grown,
    is_free,
    is_free_along,
    surely_hits,
    touched,
)

BAR = np.array([(0.6, -0.2), (0.6, 0.2), (-0.6, 0.2), (-0.6, -0.2)])
TAIL = np.array([(0.25, -0.25), (0.25, 0.25), (-0.7, 0.12), (-0.7, -0.12)])
CELL = 0.1


def meets(outline, pose, cells):
    """Whether a convex outline, cells, at a pose meets a unit square of `cells` (n, 2), rows and columns."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    corners = outline @ np.array([(c, s), (-s, c)]) + pose[:2]
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    for row, column in cells.tolist():
        square = np.array([(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)], dtype=float)
        low, high = corners.min(axis=0), corners.max(axis=0)
        if (square.min(axis=0) > high).any() or (square.max(axis=0) < low).any():
            continue
        beyond = (square @ normals.T - (corners * normals).sum(axis=1)).min(axis=0)
        if not (beyond > 0.0).any():
            return True
    return False


def one_wall():
    """40 x 40 cells with one occupied column, from x = 30 to 31 cells."""
    occupied = np.zeros((40, 40), dtype=np.bool_)
    occupied[:, 30] = True
    return occupied


@pytest.mark.parametrize(
    ("heading", "reach"), [(0.0, 6.0), (math.pi / 2, 2.0), (math.pi, 6.0), (math.pi / 4, 4.0 * math.sqrt(2.0))]
)
def test_a_bar_is_free_up_to_the_wall(heading, reach):
    # Corners of the bar are at (6, 2) cells; the outline is grown by 0.2 cells.
    ground, body = ground_of(one_wall()), body_of(BAR, 0.0, CELL)
    most = 30.0 - reach - SWEEP * (math.sqrt(2.0) if heading == math.pi / 4 else 1.0)
    assert is_free(most - 0.01, 20.3, heading, ground, body)
    assert not is_free(most + 0.01, 20.3, heading, ground, body)


def test_a_margin_moves_every_edge():
    assert grown(BAR, 0.1) == pytest.approx(np.array([(0.7, -0.3), (0.7, 0.3), (-0.7, 0.3), (-0.7, -0.3)]))


def test_a_sharp_corner_is_cut_at_twice_the_margin():
    spike = np.array([(2.0, 0.0), (-0.5, 0.3), (-0.5, -0.3)])
    outline = grown(spike, 0.1)
    assert len(outline) == 4
    assert outline[:, 0].max() == pytest.approx(2.2)


def test_outside_the_grid_no_pose_is_free():
    assert not is_free(-0.1, 5.0, 0.0, ground_of(np.zeros((10, 10), dtype=np.bool_)), body_of(BAR, 0.0, CELL))


@pytest.mark.parametrize("outline", [BAR, TAIL], ids=["bar", "tail"])
def test_poses_are_free_exactly_where_the_grown_outline_meets_no_cell(outline):
    stream = np.random.default_rng(4)
    occupied = stream.random((60, 60)) < 0.015
    ground, body, cells = ground_of(occupied), body_of(outline, 0.0, CELL), np.argwhere(occupied)
    verdicts = [0, 0]
    for pose in stream.uniform((0.0, 0.0, -4.0), (60.0, 60.0, 4.0), (400, 3)):
        hit = meets(body[0], pose, cells)
        assert is_free(*pose, ground, body) == (not hit)
        verdicts[hit] += 1
    assert min(verdicts) > 50


@pytest.mark.parametrize("outline", [BAR, TAIL], ids=["bar", "tail"])
def test_a_move_that_is_free_has_no_contact_at_any_pose(outline):
    stream = np.random.default_rng(5)
    occupied = stream.random((60, 60)) < 0.008
    ground, body, cells = ground_of(occupied), body_of(outline, 0.0, CELL), np.argwhere(occupied)
    exact, verdicts = outline / CELL, [0, 0]
    for x, y, heading, bend, length in stream.uniform((12, 12, -3, -0.25, -14), (48, 48, 3, 0.25, 14), (300, 5)):
        angle = float(stream.choice([0.0, 0.6, -0.6]))
        if not is_free(x, y, heading, ground, body):
            continue
        free = is_free_along(x, y, heading, bend, length, angle, ground, body)
        verdicts[free] += 1
        if free:
            for share in np.linspace(0.0, 1.0, 80):
                assert not meets(exact, advanced(x, y, heading, bend, share * length, 0.0), cells)
                assert not meets(exact, advanced(x, y, heading, bend, length, share * angle), cells)
    assert min(verdicts) > 30


def test_a_turn_in_place_between_walls_is_refused():
    occupied = np.zeros((40, 40), dtype=np.bool_)
    occupied[[15, 25], :] = True  # 9 cells apart: the bar is 12 long
    ground, body = ground_of(occupied), body_of(BAR, 0.0, CELL)
    assert is_free_along(20.0, 20.5, 0.0, 0.0, 0.0, 0.2, ground, body)
    assert not is_free_along(20.0, 20.5, 0.0, 0.0, 0.0, math.pi, ground, body)


def test_an_arc_ends_where_geometry_says():
    # A quarter to the left on a circle of 2 cells.
    assert advanced(1.0, 1.0, 0.0, 0.5, math.pi, 0.0) == pytest.approx((3.0, 3.0, math.pi / 2))
    assert advanced(0.0, 0.0, 0.0, 0.5, -math.pi, 0.1) == pytest.approx((-2.0, 2.0, 0.1 - math.pi / 2))


def test_the_inscribed_disc_decides_where_no_heading_helps():
    ground, body = ground_of(one_wall()), body_of(BAR, 0.0, CELL)
    assert surely_hits(29.5, 20.0, ground, body)
    assert not surely_hits(27.5, 20.0, ground, body)


def test_touched_cells_are_those_under_the_outline():
    # 12.4 x 4.4 cells around (20.5, 20.5).
    met = touched(20.5, 20.5, 0.0, ground_of(np.zeros((40, 40), dtype=np.bool_)), body_of(BAR, 0.0, CELL))
    assert met.sum() == 13 * 5
    assert met[18:23, 14:27].all()
