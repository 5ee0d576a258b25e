"""The consistency rule decides which echoes of a cone count; on cells that can be counted by hand."""

import math

import numpy as np
import pytest
from avoidance_windows import CELL, CENTRE, SIZE, at, insert
from navloom_avoidance.certainty import new_window
from navloom_avoidance.support import age_record, has_support, new_record
from navloom_improved_vfh.params import ImprovedVfhParams

SONAR = 15.0  # half angle, degrees


class Grid:
    """A window and its record; each scan is one reading of a beam along x."""

    def __init__(self, memory):
        self.window, self.heard, self.memory = new_window(SIZE), new_record(SIZE if memory else 0), memory

    def scans(self, *readings, half_angle=SONAR, pose=CENTRE):
        for reading in readings:
            insert(self.window, [[0.0, half_angle, reading]], pose=pose, heard=self.heard, memory=self.memory)
        return self.window[0]


def test_an_echo_counts_only_when_the_next_one_supports_it():
    grid = Grid(memory=1)
    assert grid.scans(1.0).sum() == 0
    grid.scans(1.0)
    assert at(grid.window, 1.05, 0.05) == 3
    assert at(grid.window, 0.05 + math.cos(math.radians(14)), 0.05 + math.sin(math.radians(14))) == 2


def test_off_is_the_default_and_counts_the_first_echo():
    assert ImprovedVfhParams().consistency == 0
    grid = Grid(memory=0)
    grid.scans(1.0)
    assert at(grid.window, 1.05, 0.05) == 3


def test_a_false_echo_between_true_ones_marks_nothing_and_takes_nothing_away():
    grid = Grid(memory=1)
    before = grid.scans(1.5, 1.5).copy()
    np.testing.assert_array_equal(grid.scans(0.8), before)
    np.testing.assert_array_equal(grid.scans(1.5), before)
    assert at(grid.window, 0.85, 0.05) == 0 and at(grid.window, 1.55, 0.05) == 3


def test_two_false_echoes_apart_do_not_support_each_other():
    """Readings 1.2 and 0.8 are cells 12 and 8 of the axis: four apart, where one is support."""
    assert Grid(memory=1).scans(1.2, 0.8).sum() == 0


def test_a_reading_beyond_an_echo_takes_its_support_away():
    """With memory for three scans the echo at 0.8 m is still kept, but the reading of 2.0 m passes it."""
    assert Grid(memory=3).scans(0.8, 2.0, 0.8).sum() == 0


def test_support_lasts_as_many_scans_as_the_record_keeps():
    """The reading between is nearer, so it does not pass the echo."""
    assert Grid(memory=1).scans(1.5, 0.8, 1.5).sum() == 0
    grid = Grid(memory=2)
    grid.scans(1.5, 0.8, 1.5)
    assert at(grid.window, 1.55, 0.05) == 3


def test_support_keeps_its_place_while_the_robot_drives():
    """0.3 m nearer, the same obstacle reads 0.7 m."""
    grid = Grid(memory=1)
    grid.scans(1.0)
    grid.scans(0.7, pose=(0.35, 0.05, 0.0))
    assert at(grid.window, 1.05, 0.05) == 3


def test_the_beam_of_a_laser_counts_at_once():
    grid = Grid(memory=1)
    grid.scans(1.0, half_angle=0.0)
    assert at(grid.window, 1.05, 0.05) == 3


@pytest.mark.parametrize(("row", "column", "supported"), [(5, 5, True), (6, 6, True), (4, 5, True), (5, 7, False)])
def test_support_reaches_one_cell(row, column, supported):
    heard = new_record(11)
    heard[5, 5] = 1
    assert not has_support(heard, row, column)  # of this scan itself
    age_record(heard, 1)
    assert has_support(heard, row, column) is supported
    age_record(heard, 1)
    assert not has_support(heard, row, column)


def test_where_every_echo_has_support_the_grid_equals_that_without_the_rule():
    """A robot at rest in a room that does not change: from the second scan on, both grids are equal bit for bit."""
    rows = [[bearing, SONAR, 1.0 + 0.003 * abs(bearing)] for bearing in (90, 50, 30, 10, -10, -30, -50, -90)]
    on, off = (new_window(SIZE), new_record(SIZE)), (new_window(SIZE), new_record(0))
    for window, heard in (on, off):
        for _ in range(2):
            insert(window, rows, margin=0.05, heard=heard, memory=1)
    assert off[0][0].max() == 3 and CELL == 0.1
    np.testing.assert_array_equal(on[0][0], off[0][0])
