"""Compiles the kernels before the robot drives."""

from __future__ import annotations

import numpy as np
from navloom_scans.field import distance_field

from navloom_people_tracker.background import explain
from navloom_people_tracker.circles import arcs, on_circles
from navloom_people_tracker.clusters import segments, shapes
from navloom_people_tracker.views import are_fresh, cover, looked_through, place_beams, view_of

__all__ = ["warm_up"]


def warm_up() -> None:
    """Compile the kernels for the arrays that they get: those of messages are read-only."""
    bearings, origins = np.zeros(2), np.zeros((2, 2))
    ranges = np.ones(2)
    for array in (bearings, origins, ranges):
        array.flags.writeable = False
    beams = np.empty((2, 5))
    place_beams(np.zeros((2, 3)), origins, bearings, ranges, np.array([0.0, 2.0]), beams)
    view = view_of(0.0, (0.0, 0.0), (0.0, 0.0), beams, 360)
    points, said = np.ascontiguousarray(beams[:, 2:4]), np.empty(2, np.int64)
    looked_through(view.near, view.x, view.y, points, np.ones((2, 2)), said)
    are_fresh(
        view.near[None], np.zeros((1, 5))[:, :2], np.ones((1, 2)), np.ones(1, np.bool_), points, np.ones(2, np.bool_)
    )
    cover(view.near, view.x, view.y, points, np.ones(2), said)
    segments(points, np.ones(2), 0.1, 0.1, said)
    shapes(points, np.zeros((2, 2), np.bool_), said, view.x, view.y, 0.1, np.empty((1, 9)))
    arcs(points, said, 0.02, 0.3, 1.0, np.zeros((1, 9)), np.empty((1, 6)))
    on_circles(points, said, said[:1], np.ones((1, 3)), np.ones(1), 0.02, np.ones(1), np.empty((1, 5)))
    field, cells = distance_field(np.eye(3, dtype=np.bool_), 0.1, (0.0, 0.0, 0.0), 1.0), np.zeros((3, 3), np.int8)
    cells.flags.writeable = False
    explain(field.values, field.frame, cells, beams, np.zeros(5), np.zeros(3), said)
