"""Differences of two answers, with numbers that can be checked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.engine.difference_units import TOLERANCES, UNITS
from navloom.engine.differences import differences, is_differing
from navloom.messages import (
    Command,
    Contact,
    MapUpdate,
    OccupancyGrid,
    Path,
    PlanFailure,
    Point2D,
    Pose2D,
    PoseEstimate,
    TrackingCommand,
    Twist2D,
)


def command(vx: float, wz: float) -> Command:
    return Command(Twist2D(vx, 0.0, wz))


def path(*points: tuple[float, float]) -> Path:
    corners = np.array(points, dtype=np.float64)
    return Path(1, corners, float(np.hypot(*np.diff(corners, axis=0).T).sum()), None)


def pose(x: float, y: float, heading: float) -> PoseEstimate:
    return PoseEstimate(0, Pose2D(x, y, heading), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))


def grid(cells: list[list[int]], resolution: float = 1.0, x: float = 0.0) -> MapUpdate:
    held = OccupancyGrid(np.array(cells, dtype=np.int8), resolution, Pose2D(x, 0.0, 0.0))
    return MapUpdate(0, held, np.zeros((0, 4)), ())


def test_the_difference_of_velocities_is_theirs_minus_ours() -> None:
    assert differences("avoider", command(0.4, 0.1), command(0.3, -0.2)) == {
        "vx": pytest.approx(-0.1),
        "vy": 0.0,
        "wz": pytest.approx(-0.3),
    }
    ours = TrackingCommand(Twist2D(0.2, 0.0, 0.0), 1.0, 2.0, 0.5)
    theirs = TrackingCommand(Twist2D(0.2, 0.0, 0.0), 0.0, 0.0, 0.0)
    assert differences("controller", ours, theirs) == {"vx": 0.0, "vy": 0.0, "wz": 0.0}


def test_paths_by_length_and_hausdorff_distance() -> None:
    # Straight 4 m, and round by a corner 1 m beside: 2 sqrt(5) m.
    found = differences("planner", path((0, 0), (4, 0)), path((0, 0), (2, 1), (4, 0)))
    assert found == {
        "found": 0.0,
        "length": pytest.approx(2 * math.sqrt(5) - 4),
        "hausdorff": pytest.approx(1.0),
    }


def test_a_path_and_a_failure_are_two_answers() -> None:
    failure = PlanFailure(1, "no_path", Point2D(0.0, 0.0), "none")
    assert differences("planner", path((0, 0), (1, 0)), failure) == {"found": 1.0}
    assert differences("planner", failure, path((0, 0), (1, 0))) == {"found": 1.0}
    assert differences("planner", failure, failure) == {"found": 0.0}
    assert is_differing({"found": 1.0}) and not is_differing({"found": 0.0})


def test_poses_by_distance_and_by_the_shorter_turn() -> None:
    found = differences("localizer", pose(0, 0, 3.0), pose(3, 4, -3.0))
    assert found == {"distance": pytest.approx(5.0), "angle": pytest.approx(2 * math.pi - 6.0)}


def test_maps_of_one_raster_by_the_cells_that_differ() -> None:
    # Of 4 cells one is free for us and occupied for them, one unknown for them; 60 and 100 are both occupied.
    ours, theirs = grid([[0, 60], [0, 0]]), grid([[100, 100], [0, -1]])
    assert differences("mapper", ours, theirs) == {"cells": 0.5, "occupied": 0.5}


def test_maps_without_anything_occupied_have_nothing_to_disagree_on() -> None:
    assert differences("mapper", grid([[0, 0]]), grid([[0, -1]])) == {"cells": 0.5, "occupied": 0.0}


def test_maps_of_other_rasters_are_compared_at_our_cells() -> None:
    # Theirs has cells of half the size and begins 1 m further on: our first cell is unknown to it, the second occupied.
    ours = grid([[0, 100, 0]])
    theirs = grid([[100, 100, 0, 0], [100, 100, 0, 0]], resolution=0.5, x=1.0)
    assert differences("mapper", ours, theirs) == {"cells": pytest.approx(1 / 3), "occupied": 0.0}


def test_a_turned_raster_is_compared_at_its_places() -> None:
    # Theirs is turned by 90°: its columns run along y, its rows along -x, from the corner (2, 0).
    ours = grid([[0, 100], [0, 0]])
    held = OccupancyGrid(np.array([[100, 0], [0, 0]], dtype=np.int8), 1.0, Pose2D(2.0, 0.0, math.pi / 2))
    turned = MapUpdate(0, held, np.zeros((0, 4)), ())
    assert differences("mapper", ours, turned) == {"cells": 0.0, "occupied": 0.0}


def test_messages_of_two_kinds_are_refused_and_others_say_nothing() -> None:
    with pytest.raises(TypeError, match="role avoider: Command and Contact, expected messages of one kind"):
        differences("avoider", command(0, 0), Contact(False))
    assert differences("platform", Contact(True), Contact(False)) == {}


def test_every_difference_has_a_unit_and_a_tolerance_and_is_the_same_up_to_it() -> None:
    assert set(UNITS) == set(TOLERANCES)
    assert not is_differing({"wz": -TOLERANCES["wz"]}) and is_differing({"wz": -1.01 * TOLERANCES["wz"]})
