"""Circles fitted to arcs that are seen in part, and what is no circle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom_people_tracker.circles import arcs, on_circles
from navloom_people_tracker.clusters import shapes
from numpy.typing import NDArray
from tracker_scenes import Scene

Floats = NDArray[np.float64]
STEP = math.tau / 360


def seen(scene: Scene, shown: slice = slice(None)) -> Floats:
    """(n, 2) echoes, m, of a scene from the origin, a part of them."""
    bearings = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    ranges = scene.ranges(0.0, (0.0, 0.0, 0.0), bearings)
    there = np.isfinite(ranges)
    return np.asarray((ranges[there, None] * np.column_stack([np.cos(bearings), np.sin(bearings)])[there])[shown])


def fitted(points: Floats) -> tuple[Floats, Floats]:
    labels, rows, fits = np.zeros(len(points), np.int64), np.empty((1, 9)), np.empty((1, 6))
    shapes(points, np.zeros((len(points), 2), np.bool_), labels, 0.0, 0.0, STEP, rows)
    arcs(points, labels, 0.02, 0.35, 1.6, rows, fits)
    return rows[0], fits[0]


CYLINDER = Scene(discs=np.array([(3.0, 1.0, 0.5)]))


def test_a_whole_arc_tells_centre_and_radius() -> None:
    row, fit = fitted(seen(CYLINDER))
    assert row[:3] == pytest.approx([3.0, 1.0, 0.5], abs=0.01) and 0.0 < fit[5] < 0.05


def test_half_an_arc_tells_the_centre_of_a_circle_of_known_radius() -> None:
    points, found = seen(CYLINDER, slice(0, 9)), np.empty((1, 5))  # of 18
    expected = np.array([(2.9, 1.1, 0.5)])
    labels = np.zeros(len(points), np.int64)
    on_circles(points, labels, labels[:1], expected, np.array([0.01]), 0.02, np.array([0.5]), found)
    assert found[0, :2] == pytest.approx([3.0, 1.0], abs=0.01)


def test_one_echo_tells_the_centre_along_the_radius_only() -> None:
    """The echo at (2.5, 0) of a disc round (3, 0): along x within noise, across it as unsure as before."""
    found, labels = np.empty((1, 5)), np.zeros(1, np.int64)
    circle, echo = np.array([(3.1, 0.0, 0.5)]), np.array([(2.5, 0.0)])
    on_circles(echo, labels, labels, circle, np.zeros(1), 0.02, np.array([0.3]), found)
    assert found[0, 0] == pytest.approx(3.0, abs=0.01)
    assert math.sqrt(found[0, 2]) == pytest.approx(0.02, rel=0.01) and math.sqrt(found[0, 4]) > 0.25


@pytest.mark.parametrize("length", [0.4, 0.6, 1.0, 1.5])
@pytest.mark.parametrize("turn", [0.0, 0.5, 1.0])
def test_a_part_of_a_wall_is_no_circle(length: float, turn: float) -> None:
    x, y = 0.5 * length * math.sin(turn), 0.5 * length * math.cos(turn)
    noise = 0.02 * np.random.default_rng(1).standard_normal(360)
    points = seen(Scene(walls=np.array([(3.0 - x, -y, 3.0 + x, y)])))
    far = np.hypot(*points.T)
    _, fit = fitted(points * (1.0 + noise[: len(points)] / far)[:, None])
    assert fit[5] == 0.0
