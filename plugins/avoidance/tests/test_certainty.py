"""The switch law of Fig. 5 on cells that can be counted by hand."""

import math

import numpy as np
from avoidance_windows import CELL, CENTRE, SIZE, at, filled_window, insert
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_avoidance.certainty import new_window, occupied_cells
from navloom_avoidance.clearance import footprint_edges

SQUARE = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])


def test_axis_cell_gets_three_and_the_rest_of_the_arc_two():
    window = new_window(SIZE)
    insert(window, [[0.0, 15.0, 1.0]])
    assert at(window, 1.05, 0.05) == 3
    assert at(window, 0.05 + math.cos(math.radians(14)), 0.05 + math.sin(math.radians(14))) == 2
    assert at(window, 0.05 + math.cos(math.radians(-14)), 0.05 - math.sin(math.radians(14))) == 2
    assert set(np.unique(window[0])) == {0, 2, 3}
    assert (window[0] == 3).sum() == 1


def test_values_are_assigned_and_not_counted_up():
    window = new_window(SIZE)
    for _ in range(5):
        insert(window, [[0.0, 15.0, 1.0]])
    assert window[0].max() == 3


def test_cells_of_the_cone_nearer_than_the_echo_become_zero():
    window = filled_window()
    insert(window, [[0.0, 15.0, 1.0]])
    assert at(window, 0.65, 0.05) == 0
    assert at(window, 0.65, 0.45) == 2  # 34 degrees off the axis: outside the cone
    assert at(window, 1.35, 0.05) == 2  # behind the echo: not visible


def test_no_echo_zeroes_the_whole_cone():
    window = filled_window()
    insert(window, [[0.0, 15.0, math.inf]])
    assert at(window, 1.95, 0.05) == 0
    assert at(window, 1.95, 0.35) == 0
    assert at(window, -0.55, 0.05) == 2


def test_an_echo_beyond_range_max_counts_as_no_echo():
    window = filled_window()
    insert(window, [[0.0, 15.0, 4.5]])
    assert at(window, 1.95, 0.05) == 0


def test_memory_survives_with_cone_and_not_with_window():
    for forgets, left in ((False, 3), (True, 0)):
        window = new_window(SIZE)
        insert(window, [[180.0, 15.0, 1.0]])
        insert(window, [[0.0, 15.0, 1.0]], forgets=forgets)
        assert at(window, -0.95, 0.05) == left


def test_window_scrolls_by_whole_cells_and_its_contents_stay_in_place():
    window = new_window(SIZE)
    insert(window, [[0.0, 0.0, 1.0]])
    insert(window, [[180.0, 0.0, math.inf]], pose=(0.05 + 0.37, 0.05 - 0.52, 0.3))
    assert at(window, 1.05, 0.05) == 3
    assert window[0].sum() == 3
    np.testing.assert_array_equal(window[1], [4 - 20, -5 - 20])


def test_cells_that_leave_the_window_are_forgotten():
    window = new_window(SIZE)
    insert(window, [[0.0, 0.0, 1.0]])
    insert(window, [[180.0, 0.0, math.inf]], pose=(-2.0, 0.05, 0.0))
    insert(window, [[180.0, 0.0, math.inf]], pose=CENTRE)
    assert window[0].sum() == 0


def test_thin_beam_of_a_laser_marks_one_cell_and_clears_its_line():
    window = filled_window()
    insert(window, [[90.0, 0.0, 1.2]])
    assert at(window, 0.05, 1.25) == 3
    assert [at(window, 0.05, y) for y in (0.15, 0.65, 1.15)] == [0, 0, 0]
    assert at(window, 0.15, 0.65) == 2


def test_part_of_an_arc_that_a_neighbour_sees_through_is_left_out():
    ten = (math.cos(math.radians(10)), math.sin(math.radians(10)))
    for sensors, value in (((0, 0), 0), ((0, 1), 2), ((-1, -1), 2)):
        window = new_window(SIZE)
        insert(window, [[0.0, 15.0, 1.0], [20.0, 15.0, math.inf]], sensors=sensors)
        assert at(window, 0.05 + ten[0], 0.05 + ten[1]) == value
        assert at(window, 1.05, 0.05) == 3


def test_reading_at_range_min_marks_the_depth_before_it_too():
    for depth, value in ((0.0, 0), (0.25, 2)):
        window = new_window(SIZE)
        insert(window, [[0.0, 15.0, 0.3]], depth=depth)
        assert at(window, 0.25, 0.05) == value
        assert at(window, 0.35, 0.05) == 3


def test_cells_in_the_blind_zone_of_a_sensor_are_kept():
    for clears, value in ((True, 0), (False, 2)):
        window = filled_window()
        insert(window, [[0.0, 15.0, 1.0]], clears_blind=clears)
        assert at(window, 0.25, 0.05) == value


def test_cells_under_the_robot_are_set_free_and_those_beside_it_kept():
    window = new_window(SIZE)
    window[0][20, 20] = window[0][20, 26] = 2  # centres at base (0, 0) and (0.6, 0)
    cells = np.zeros((SIZE * SIZE, 3))
    window[1][:] = -20
    assert occupied_cells(*window, CELL, CENTRE, footprint_edges(SQUARE), cells) == 1
    np.testing.assert_allclose(cells[0], [0.6, 0.0, 2.0], atol=1e-12)
    assert window[0][20, 20] == 0


@settings(max_examples=50, deadline=None)
@given(st.permutations(range(4)), st.lists(st.floats(0.35, 1.8), min_size=4, max_size=4), st.floats(-3.0, 3.0))
def test_answer_does_not_depend_on_the_order_of_the_beams(order, ranges, heading):
    beams = [[bearing, 15.0, r] for bearing, r in zip((-30.0, -10.0, 10.0, 30.0), ranges, strict=True)]
    grids = []
    for rows in (beams, [beams[i] for i in order]):
        window = new_window(SIZE)
        insert(window, rows, pose=(0.05, 0.05, heading))
        grids.append(window[0])
    np.testing.assert_array_equal(grids[0], grids[1])


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 3), st.floats(0.4, 1.8), st.floats(-60.0, 60.0))
def test_quarter_turn_of_robot_turns_the_window(quarters, distance, bearing):
    windows = []
    for heading in (0.0, quarters * math.pi / 2):
        window = new_window(SIZE)
        insert(window, [[bearing, 12.0, distance]], pose=(0.05, 0.05, heading + 0.01))
        windows.append(window[0])
    # A point within rounding of a cell's side may fall to either cell after the turn.
    assert (np.rot90(windows[0], -quarters) != windows[1]).sum() <= 2
