"""One scan in the grid: cells counted by hand, and properties of any scan."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_ipabd.errors import SettingError
from navloom_scan_grid.grid import Bounds, LogOddsGrid
from navloom_scan_grid.kernels import Weights
from navloom_scan_grid.models import cone_log_odds

WEIGHTS = Weights(1.0, -0.5, 0.4, -0.8, -2.0, 3.5, 0.0, 0.0, 0.1, True)
LIMITS = (0.05, 5.0)
CELL = 0.1


def grid_of(size: float = 6.0) -> LogOddsGrid:
    return LogOddsGrid(CELL, 10, (-size, -size, size - 0.01, size - 0.01))


def beam(x: float, y: float, angle: float, reading: float, half_angle: float = 0.0) -> list[float]:
    return [x, y, math.cos(angle), math.sin(angle), reading, half_angle]


def at(grid: LogOddsGrid, x: float, y: float) -> float:
    """Log odds of the cell at a place."""
    return float(grid.odds[math.floor(y / CELL) - grid.bounds.row, math.floor(x / CELL) - grid.bounds.column])


def told(grid: LogOddsGrid) -> dict[tuple[int, int], float]:
    """Known cells (column, row) of the map's lattice, with their log odds."""
    rows, columns = np.nonzero(~np.isnan(grid.odds))
    b = grid.bounds
    return {(c + b.column, r + b.row): float(grid.odds[r, c]) for r, c in zip(rows, columns, strict=True)}


def test_a_beam_along_a_row() -> None:
    grid = grid_of()
    grid.insert(np.array([beam(0.05, 0.05, 0.0, 0.5)]), LIMITS, WEIGHTS)
    assert told(grid) == {**{(c, 0): -0.5 for c in range(5)}, (5, 0): 1.0}


def test_an_oblique_beam_crosses_each_cell_of_its_line_once() -> None:
    """From (0.05, 0.05) with slope 1/2 to (0.45, 0.25): borders at x = 0.1, 0.2, 0.3, 0.4 and y = 0.1, 0.2."""
    grid = grid_of()
    grid.insert(np.array([beam(0.05, 0.05, math.atan2(1.0, 2.0), math.hypot(0.4, 0.2))]), LIMITS, WEIGHTS)
    free = [(0, 0), (1, 0), (1, 1), (2, 1), (3, 1), (3, 2)]
    assert set(told(grid)) <= {*free, (4, 2), (2, 0), (0, 1), (2, 2), (4, 1)}
    assert told(grid)[(4, 2)] == 1.0
    assert len(told(grid)) == 7


@pytest.mark.parametrize("angle_deg", range(-180, 180, 45))
def test_axis_and_diagonal_beams_end_where_their_echo_is(angle_deg: int) -> None:
    grid, angle = grid_of(), math.radians(angle_deg)
    grid.insert(np.array([beam(0.03, 0.02, angle, 2.03)]), LIMITS, WEIGHTS)
    assert at(grid, 0.03 + 2.03 * math.cos(angle), 0.02 + 2.03 * math.sin(angle)) == 1.0
    assert [value for value in told(grid).values() if value > 0.0] == [1.0]


def test_in_one_scan_an_echo_wins_over_a_beam_that_passes() -> None:
    """The second beam grazes the cell in which the first ends."""
    beams = np.array([beam(0.05, 0.05, 0.0, 0.5), beam(0.05, 0.06, 0.0, 0.9)])
    for order in (beams, beams[::-1].copy()):
        grid = grid_of()
        grid.insert(order, LIMITS, WEIGHTS)
        assert (at(grid, 0.55, 0.05), at(grid, 0.95, 0.05), at(grid, 0.25, 0.05)) == (1.0, 1.0, -0.5)


def test_many_beams_through_one_cell_count_once_a_scan_but_every_scan_counts() -> None:
    grid = grid_of()
    fan = np.array([beam(0.05, 0.05, angle, 3.0) for angle in np.linspace(-0.05, 0.05, 21)])
    grid.insert(fan, LIMITS, WEIGHTS)
    assert at(grid, 0.25, 0.05) == -0.5
    grid.insert(fan, LIMITS, WEIGHTS)
    assert at(grid, 0.25, 0.05) == -1.0


def test_log_odds_are_clamped_so_that_a_cell_can_change() -> None:
    """3.5 less 8 times 0.5 is below 0: a removed wall is free after 8 scans, however long it was there."""
    grid = grid_of()
    for _ in range(100):
        grid.insert(np.array([beam(0.05, 0.05, 0.0, 1.0)]), LIMITS, WEIGHTS)
    assert (at(grid, 1.05, 0.05), at(grid, 0.55, 0.05)) == (3.5, -2.0)
    for count in range(8):
        assert at(grid, 1.05, 0.05) == 3.5 - 0.5 * count
        grid.insert(np.array([beam(0.05, 0.05, 0.0, 2.0)]), LIMITS, WEIGHTS)
    assert at(grid, 1.05, 0.05) == pytest.approx(-0.5)


def test_no_echo_frees_up_to_the_reach_and_occupies_nothing() -> None:
    grid = grid_of()
    grid.insert(np.array([beam(0.05, 0.05, 0.0, math.inf)]), LIMITS, WEIGHTS)
    assert told(grid) == {(c, 0): -0.5 for c in range(51)}


@pytest.mark.parametrize("half_angle", [0.0, 0.26])
def test_beams_without_an_echo_can_be_ignored(half_angle: float) -> None:
    grid = grid_of()
    no = WEIGHTS._replace(no_echo_clears=False)
    grid.insert(np.array([beam(0.05, 0.05, 0.0, math.inf, half_angle)]), LIMITS, no)
    assert told(grid) == {}
    grid.insert(np.array([beam(0.05, 0.05, 0.0, 5.5, half_angle)]), LIMITS, no)  # an echo beyond the reach
    assert max(told(grid).values()) < 0.0


def test_a_reading_at_the_sensors_minimum_frees_nothing() -> None:
    grid = grid_of()
    grid.insert(np.array([beam(0.05, 0.05, 0.0, 0.3)]), (0.3, 5.0), WEIGHTS)
    assert told(grid) == {(3, 0): 1.0}


def test_a_cone_gives_each_cell_what_the_model_says_of_its_centre() -> None:
    grid = grid_of()
    grid.insert(np.array([beam(0.0, 0.0, 0.6, 2.0, 0.26)]), LIMITS, WEIGHTS)
    for column in range(-5, 30):
        for row in range(-5, 30):
            x, y = (column + 0.5) * CELL, (row + 0.5) * CELL
            angle = abs(math.remainder(math.atan2(y, x) - 0.6, math.tau))
            wanted = cone_log_odds(math.hypot(x, y), angle, 2.0, 0.26, *LIMITS, 0.1, 0.4, -0.8)
            assert told(grid).get((column, row), 0.0) == pytest.approx(wanted, abs=1e-6)


def test_an_arc_hardly_occupies_cells_that_beams_have_passed() -> None:
    """A cell at -2 gets e^-2 of what an unknown one gets."""
    grid, fresh = grid_of(), grid_of()
    arc = np.array([beam(0.0, 0.05, 0.0, 2.05, 0.26)])
    for _ in range(9):
        grid.insert(np.array([beam(0.05, 0.05, 0.0, 3.0)]), LIMITS, WEIGHTS)
    assert at(grid, 2.05, 0.05) == -2.0
    grid.insert(arc, LIMITS, WEIGHTS)
    fresh.insert(arc, LIMITS, WEIGHTS)
    assert at(grid, 2.05, 0.05) + 2.0 == pytest.approx(math.exp(-2.0) * at(fresh, 2.05, 0.05), rel=1e-4)
    assert at(grid, 2.05, 0.25) == at(fresh, 2.05, 0.25)


HALF_ANGLE = 0.26


def cell_heard(*cones: list[float], times: int = 1) -> tuple[float, int]:
    """Log odds of the cell at (2.05, 0.05), and its published value, after an echo from it and then other cones."""
    grid = grid_of()
    for cone in (beam(0.0, 0.05, 0.0, 2.05, HALF_ANGLE), *cones * times):
        grid.insert(np.array([cone]), LIMITS, WEIGHTS)
    row, column = math.floor(0.05 / CELL) - grid.bounds.row, math.floor(2.05 / CELL) - grid.bounds.column
    return float(grid.odds[row, column]), int(grid.render(0.6, True)[row, column])


def test_a_place_with_an_echo_is_unknown_until_it_is_occupied_or_seen_through() -> None:
    """One echo gives 0.4 on its axis, less than the 0.6 of an occupied cell."""
    odds, shown = cell_heard()
    assert odds == pytest.approx(0.4, rel=0.01) and shown == -1


@pytest.mark.parametrize("flank", [-0.2, 0.2])
def test_a_flank_does_not_erase_what_another_cone_heard(flank: float) -> None:
    assert cell_heard(beam(0.0, 0.05, flank, 3.5, HALF_ANGLE), times=40) == cell_heard()


def test_nine_cones_that_see_through_a_place_outweigh_one_echo() -> None:
    through = beam(0.0, 0.05, 0.0, 3.5, HALF_ANGLE)
    assert [cell_heard(through, times=count)[1] for count in (1, 8, 9)] == [-1, -1, 0]


def test_a_silent_cone_speaks_only_against_echoes_of_its_own_direction() -> None:
    """A smooth surface sends the sound of other directions away: here from (2.05, -1.95), a quarter turn beside."""
    assert cell_heard(beam(2.05, -1.95, 0.5 * math.pi, math.inf, HALF_ANGLE), times=40) == cell_heard()
    assert cell_heard(beam(0.0, 0.05, 0.0, math.inf, HALF_ANGLE), times=9)[1] == 0


def test_a_silent_cone_clears_nothing_behind_a_place_with_an_echo() -> None:
    grid = grid_of()
    grid.insert(np.array([beam(0.0, 0.05, 0.0, 2.05, HALF_ANGLE)]), LIMITS, WEIGHTS)
    grid.insert(np.array([beam(0.0, 0.05, 0.0, math.inf, HALF_ANGLE)]), LIMITS, WEIGHTS)
    assert math.isnan(at(grid, 2.55, 0.05)) and at(grid, 1.55, 0.05) < 0.0


def test_a_silent_cone_clears_up_to_the_surface_that_another_one_hears() -> None:
    """A wall 1 m to the left, heard across: along 45° it is 1.41 m away, and the oblique sonar hears nothing of it."""
    grid, wall = grid_of(), beam(0.05, 0.05, 0.5 * math.pi, 1.0, HALF_ANGLE)
    grid.insert(np.array([wall, beam(0.05, 0.05, 0.25 * math.pi, math.inf, HALF_ANGLE)]), LIMITS, WEIGHTS)
    along = [0.05 + length * math.sqrt(0.5) for length in (1.2, 1.6, 2.5)]
    assert [at(grid, x, x) < 0.0 for x in along] == [True, False, False]


def test_a_silent_cone_clears_a_cell_once() -> None:
    """So the first echoes outweigh it. A cone clears at most -0.8, right before the sensor."""
    grid = grid_of()
    for _ in range(9):
        grid.insert(np.array([beam(0.0, 0.05, 0.0, math.inf, HALF_ANGLE)]), LIMITS, WEIGHTS)
    assert np.nanmin(grid.odds) == pytest.approx(-0.8)


def test_the_rest_of_an_arc_is_unknown_until_its_log_odds_are_not_positive() -> None:
    """At 12° of 15° the arc gives 0.4 · (1 - 0.64) = 0.14: neither occupied nor free, and a flank clears it."""
    grid, turn = grid_of(), 0.8 * HALF_ANGLE
    x, y = 2.05 * math.cos(turn), 0.05 + 2.05 * math.sin(turn)
    row, column = math.floor(y / CELL) - grid.bounds.row, math.floor(x / CELL) - grid.bounds.column
    grid.insert(np.array([beam(0.0, 0.05, 0.0, 2.05, HALF_ANGLE)]), LIMITS, WEIGHTS)
    assert 0.0 < grid.odds[row, column] < 0.3 and grid.render(0.6, True)[row, column] == -1
    grid.insert(np.array([beam(0.0, y - 0.35, 0.0, 3.5, HALF_ANGLE)]), LIMITS, WEIGHTS)
    assert grid.odds[row, column] < 0.0 and grid.render(0.6, True)[row, column] == 0


def test_no_cone_clears_a_place_with_an_echo_beyond_a_surface_that_another_echo_shows() -> None:
    """A wall 1 m to the left. A place 2.05 m along 45° was heard, and a farther echo there does not make it free."""
    grid, wall, along = grid_of(), beam(0.05, 0.05, 0.5 * math.pi, 1.0, HALF_ANGLE), 0.05 + 2.05 * math.sqrt(0.5)
    grid.insert(np.array([wall, beam(0.05, 0.05, 0.25 * math.pi, 2.05, HALF_ANGLE)]), LIMITS, WEIGHTS)
    before = at(grid, along, along)
    for _ in range(40):
        grid.insert(np.array([wall, beam(0.05, 0.05, 0.25 * math.pi, 3.5, HALF_ANGLE)]), LIMITS, WEIGHTS)
    assert at(grid, along, along) == before


def test_a_laser_that_sees_through_the_rest_of_an_arc_makes_it_free() -> None:
    grid, turn = grid_of(), 0.8 * HALF_ANGLE
    x, y = 2.05 * math.cos(turn), 0.05 + 2.05 * math.sin(turn)
    row, column = math.floor(y / CELL) - grid.bounds.row, math.floor(x / CELL) - grid.bounds.column
    grid.insert(np.array([beam(0.0, 0.05, 0.0, 2.05, HALF_ANGLE)]), LIMITS, WEIGHTS)
    grid.insert(np.array([beam(0.0, 0.05, turn, 3.5)]), LIMITS, WEIGHTS)
    assert grid.render(0.6, True)[row, column] == 0


BEAMS = st.lists(
    st.tuples(
        # Steps that do not meet borders of cells, where the side is a matter of rounding.
        st.integers(-30, 30).map(lambda k: 0.0371 * k + 0.0123),
        st.integers(-30, 30).map(lambda k: 0.0371 * k + 0.0123),
        st.integers(0, 500).map(lambda k: 0.0123 * k + 0.0077),
        st.one_of(st.integers(1, 80).map(lambda k: 0.0717 * k + 0.0013), st.just(math.inf)),
    ),
    min_size=1,
    max_size=30,
)


@settings(max_examples=40, deadline=None)
@given(BEAMS)
def test_a_scan_occupies_cells_of_echoes_frees_cells_before_them_and_keeps_the_rest(beams: list) -> None:
    """Checked every 2 mm along each beam: exactly the crossed cells have changed, and in the right direction."""
    grid = grid_of(8.0)
    grid.insert(np.array([beam(*one) for one in beams]), LIMITS, WEIGHTS)
    known = told(grid)
    echoes = {
        (math.floor((x + r * math.cos(a)) / CELL), math.floor((y + r * math.sin(a)) / CELL))
        for x, y, a, r in beams
        if r <= LIMITS[1]
    }
    assert {cell for cell, value in known.items() if value == 1.0} == echoes
    assert {value for cell, value in known.items() if cell not in echoes} <= {-0.5}
    crossed, near = set(), set()
    for x, y, a, r in beams:
        along = np.arange(0.0, min(r, LIMITS[1]), 0.002)
        px, py = (x + along * math.cos(a)) / CELL, (y + along * math.sin(a)) / CELL
        crossed |= set(zip(np.floor(px).astype(int).tolist(), np.floor(py).astype(int).tolist(), strict=True))
        for dx, dy in ((-0.02, -0.02), (-0.02, 0.02), (0.02, -0.02), (0.02, 0.02)):
            shifted = np.floor(px + dx).astype(int).tolist(), np.floor(py + dy).astype(int).tolist()
            near |= set(zip(*shifted, strict=True))
    assert crossed <= set(known)
    assert set(known) <= crossed | near | echoes


@settings(max_examples=30, deadline=None)
@given(st.integers(-60, 60), st.integers(-60, 60), st.integers(0, 40), st.integers(0, 40))
def test_growing_the_grid_keeps_its_cells(column: int, row: int, columns: int, rows: int) -> None:
    grid = LogOddsGrid(CELL, 10, (0.0, 0.0, 0.0, 0.0))
    grid.insert(np.array([beam(0.05, 0.05, 0.0, 0.5)]), LIMITS, WEIGHTS)
    before = told(grid)
    box = (column * CELL, row * CELL, (column + columns) * CELL, (row + rows) * CELL)
    grid.cover(box)
    b = grid.bounds
    assert told(grid) == before
    assert {value % 10 for value in (b.column, b.row, b.columns, b.rows)} == {0}
    assert grid.origin[0] <= box[0] + 1e-9 and grid.origin[1] <= box[1] + 1e-9
    assert grid.origin[0] + b.columns * CELL > box[2] - 1e-9 and grid.origin[1] + b.rows * CELL > box[3] - 1e-9


def test_a_grid_that_would_be_too_large_is_refused_and_left_alone() -> None:
    grid = grid_of()
    before = grid.bounds
    with pytest.raises(SettingError, match=r"map\.extent, cell: got \d+ × \d+ cells of 0\.1 m, expected at most"):
        grid.cover((0.0, 0.0, 1e5, 1e5))
    assert grid.bounds == before and grid.odds.shape == (before.rows, before.columns)


@pytest.mark.parametrize("hair", [-1e-13, 0.0, 1e-13], ids=["before", "on", "behind"])
def test_a_beam_that_ends_on_the_grids_border_changes_no_cell_of_another_row(hair: float) -> None:
    """A point that rounding puts beyond the border changes no cell of the grid, now or in a later scan."""
    grid = LogOddsGrid(CELL, 10, (0.0, 0.0, 0.99, 0.99))
    for _ in range(2):
        grid.insert(np.array([beam(0.55, 0.35, 0.0, 0.45 + hair)]), LIMITS, WEIGHTS)
    assert {row for _, row in told(grid)} == {3}
    assert {column for column, _ in told(grid)} >= {5, 6, 7, 8}
    assert told(grid)[(5, 3)] == -1.0


def test_a_beam_that_leaves_the_grid_is_left_out() -> None:
    grid = LogOddsGrid(CELL, 10, (0.0, 0.0, 0.99, 0.99))
    grid.insert(np.array([beam(0.55, 0.35, 0.0, 2.0), beam(0.55, 0.35, math.pi, 0.2)]), LIMITS, WEIGHTS)
    assert told(grid) == {(5, 3): -0.5, (4, 3): -0.5, (3, 3): 1.0}


def test_bounds_are_whole_chunks() -> None:
    assert Bounds.of((0.0, -0.01, 0.0, 0.99), 0.1, 10) == Bounds(0, -10, 10, 20)
