"""The campaign of the cold start: which worlds a body fits through, its settings, and its table."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.geometry.world import Box, Place, World

sys.path.insert(0, str(Path(__file__).parents[1]))
from cold_start import BODIES, fits, table


def rectangle(length: float, width: float) -> np.ndarray:
    return 0.5 * np.array([(length, -width), (length, width), (-length, width), (-length, -width)])


def doorway(gap: float) -> World:
    """A wall across the way from start to goal, with a gap in its middle, m."""
    walls = (Box("left", (2.0, 2.2), (0.5 * gap, 3.0)), Box("right", (2.0, 2.2), (-3.0, -0.5 * gap)))
    return World("doorway", walls, start=Place(0.0, 0.0), goal=Place(4.0, 0.0), bounds=(-1.0, -3.0, 5.0, 3.0))


def elbow(width: float) -> World:
    """A corridor of this width, m, that turns left by a right angle after 3 m."""
    walls = (
        Box("right", (-2.0, 3.0 + width), (-1.0, -0.5 * width)),
        Box("left", (-2.0, 3.0), (0.5 * width, 5.0)),
        Box("end", (3.0 + width, 6.0), (-1.0, 5.0)),
    )
    goal = Place(3.0 + 0.5 * width, 4.0)
    return World("elbow", walls, start=Place(0.0, 0.0), goal=goal, bounds=(-1.0, -1.0, 5.0, 5.0))


@pytest.mark.parametrize(("gap", "is_wide"), [(0.8, True), (0.6, False)])
def test_a_body_fits_through_a_gap_with_room_on_both_sides(gap: float, is_wide: bool) -> None:
    """0.5 m wide and 0.1 m of room on either side: 0.7 m, up to two cells of 0.05 m."""
    assert fits(doorway(gap), rectangle(0.5, 0.5)) is is_wide


@pytest.mark.parametrize(("width", "turns"), [(1.5, True), (0.7, False)])
def test_a_long_body_fits_round_a_corner_only_where_it_can_turn(width: float, turns: bool) -> None:
    """1.2 x 0.4 m has a diagonal of 1.26 m; through a straight corridor of 0.7 m it fits with 0.1 m of room."""
    assert fits(elbow(width), rectangle(1.2, 0.4)) is turns
    assert fits(doorway(0.7), rectangle(1.2, 0.4))


@pytest.mark.parametrize("name", BODIES)
def test_a_config_describes_the_body(name: str) -> None:
    body = BODIES[name]
    system = assemble(load_config("building", body.settings()))
    assert np.ptp(system.robot.footprint, axis=0) == pytest.approx(np.ptp(body.corners, axis=0), abs=0.01)
    assert system.robot.motor_lag == system.config.platform.params["motor_time_constant"] == body.motor_lag
    assert len(system.sensors) == len(body.lasers)


def test_bodies_differ_in_limits_lags_and_lasers() -> None:
    for values in (
        {body.robot["max_linear"] for body in BODIES.values()},
        {body.motor_lag for body in BODIES.values()},
        {(body.lasers[0]["beams"], body.lasers[0]["range_max"]) for body in BODIES.values()},
    ):
        assert len(values) == len(BODIES)


def test_the_table_counts_arrivals_and_contacts() -> None:
    row = {"body": "puck", "kind": "floor", "arrived": True, "contacts": 0, "recoveries": 1, "time_s": 100.0,
           "optimal_m": 15.0}  # fmt: skip
    rows = [row, row | {"arrived": False, "contacts": 2}]
    # 15 m at 0.3 m/s are 50 s.
    assert table(rows).splitlines()[-1].split() == ["all", "all", "2", "0.500", "1", "2", "2.00"]
    assert math.isnan(float(table(rows[1:]).splitlines()[-1].split()[-1]))
