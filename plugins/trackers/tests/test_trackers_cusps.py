"""Paths with headings: each tracker follows them forwards and backwards, with steered and differential bodies."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cusp_drives import CUSPS, DIFFERENTIAL, HOLONOMIC, drive
from navloom import Box

TRACKERS = [
    "lyapunov_tracker", "kanayama", "ramsete", "fierro_lewis", "pure_pursuit", "regulated_pure_pursuit", "graceful",
]  # fmt: skip
QUICK = ("three_point_turn",)
LONG = [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in CUSPS]


@pytest.mark.parametrize("path", LONG)
@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_steered_body_follows_cusps_to_the_heading_at_their_end(tracker: str, path: str) -> None:
    """The third table of the README."""
    found = drive(tracker, CUSPS[path]())
    errors = f"{1e3 * found.rms:.1f}, {1e3 * found.most:.1f}, {1e3 * found.overshoot:.1f} mm"
    at_goal = f"{1e3 * found.off:.0f} mm, {abs(math.degrees(found.turned)):.1f} deg"
    print(f"{tracker} {path}: {errors}; {found.seconds:.1f} s; {at_goal} off")
    assert (found.outcome, found.contacts) == ("succeeded", 0)
    assert found.most < 0.12 and found.overshoot < 0.02
    assert abs(found.turned) < math.radians(5.0)


@pytest.mark.parametrize("tracker", ["lyapunov_tracker", "regulated_pure_pursuit"])
def test_a_differential_body_backs_along_its_path(tracker: str) -> None:
    found = drive(tracker, CUSPS["backwards"](), DIFFERENTIAL)
    assert found.outcome == "succeeded" and found.track[:, 4].min() < -0.15
    assert found.most < 0.03


def test_a_three_point_turn_between_walls_touches_nothing() -> None:
    """The corners of the body sweep from y = -0.87 m to 1.39 m; the walls stand 0.12 m farther."""
    walls = [Box("left", (-1.5, 3.5), (1.51, 1.61)), Box("right", (-1.5, 3.5), (-1.09, -0.99))]
    found = drive("kanayama", CUSPS["three_point_turn"](), walls=walls)
    assert (found.outcome, found.contacts) == ("succeeded", 0)
    assert found.clearance > 0.08


def test_a_holonomic_body_drives_sideways_through_a_gap_that_it_fits_through_only_so() -> None:
    """0.8 m long and 0.4 m wide, between two walls 0.6 m apart, heading along the walls' normal all the time."""
    points = np.array([[0.0, 0.0], [0.0, 3.0], [1.0, 3.0]])
    walls = [Box("left", (-1.5, -0.5), (1.0, 2.0)), Box("right", (0.5, 1.5), (1.0, 2.0))]
    found = drive("lyapunov_tracker", (points, np.zeros(3)), HOLONOMIC, walls=walls)
    assert (found.outcome, found.contacts) == ("succeeded", 0)
    assert np.abs(found.track[:, 3]).max() < math.radians(1.0), "it never turns"
    assert found.most < 0.04


def test_a_tracker_that_cannot_drive_sideways_says_so() -> None:
    points = np.array([[0.0, 0.0], [0.0, 1.0]])
    found = drive("kanayama", (points, np.zeros(2)), HOLONOMIC)
    assert found.outcome == "error"
    assert "expected one that drives along its heading: take lyapunov_tracker" in found.reason


def test_on_the_way_back_the_controller_drives_though_the_avoider_always_does() -> None:
    """The avoider looks ahead: to a place behind it, it would turn the robot round."""
    found = drive("kanayama", CUSPS["parking"](), settings=['navigation.handover="always"'])
    assert found.outcome == "succeeded"
    assert found.track[:, 4].min() < -0.15
