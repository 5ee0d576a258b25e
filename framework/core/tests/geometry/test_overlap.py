"""Depth of an overlap, on shapes where it is plain to see."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.geometry.collision import clearance
from navloom.geometry.footprints import rectangle
from navloom.geometry.overlap import overlap_depth
from navloom.geometry.world import Box, Cylinder, Place, Raster, World

ROBOT = rectangle(0.8, 0.4)
BOX = Box("box", (1.0, 2.0), (-1.0, 1.0))
MAST = Cylinder("mast", 0.0, 5.0, 0.1)
PERSON = Cylinder("person", 0.0, 0.0, 0.2, waypoints=((0.0, 9.0, 0.0), (10.0, -1.0, 0.0)))
WORLD = World("hall", (BOX, MAST, PERSON))


@pytest.mark.parametrize(
    ("pose", "name", "time", "depth"),
    [
        (Place(0.65, 0.0), "box", 0.0, 0.05),
        (Place(0.6, 0.0), "box", 0.0, 0.0),
        (Place(0.4, 0.0), "box", 0.0, 0.0),
        (Place(0.65, 0.0), "mast", 0.0, 0.0),
        (Place(0.65, 0.0), "elsewhere", 0.0, 0.0),
        (Place(1.5, -1.15), "box", 0.0, 0.05),
        (Place(1.0 - 0.2 * math.sqrt(5.0) + 0.03, 0.0, -math.atan2(0.2, 0.4)), "box", 0.0, 0.03),
        (Place(0.0, 4.75), "mast", 0.0, 0.05),
        (Place(0.0, 5.0), "mast", 0.0, 0.3),
        (Place(0.45, 5.0), "mast", 0.0, 0.05),
        (Place(0.4 + 0.06, 5.2 + 0.06), "mast", 0.0, 0.1 - 0.06 * math.sqrt(2.0)),
        (Place(0.0, 0.0), "person", 8.5, 0.1),
        (Place(0.0, 0.0), "person", 8.0, 0.0),
    ],
    ids=["front", "touching", "apart", "another", "unknown", "below", "turned", "side", "middle", "end", "corner",
         "met", "not_yet"],
)  # fmt: skip
def test_depth_is_the_shortest_way_out(pose: Place, name: str, time: float, depth: float) -> None:
    assert overlap_depth(ROBOT, pose, WORLD, name, time) == pytest.approx(depth, abs=1e-12)


def test_a_raster_tells_the_depth_in_one_cell() -> None:
    cells = np.zeros((10, 20), dtype=np.bool_)
    cells[5, 10:] = True
    world = World("walled", raster=Raster("walls", cells, 0.1, Place(2.0, 1.0, math.pi / 2)))
    # The wall's end is at 1.0 m along the raster's x, which is the map's y: at y = 2 m, x = 1.4 to 1.5 m.
    for x, y, depth in ((1.45, 1.57, 0.0), (1.45, 1.63, 0.03), (1.45, 1.8, 0.1), (5.0, 5.0, 0.0)):
        assert overlap_depth(ROBOT, Place(x, y, math.pi / 2), world, "walls") >= depth - 1e-12
        assert (depth == 0.0) == (overlap_depth(ROBOT, Place(x, y, math.pi / 2), world, "walls") == 0.0)
    assert overlap_depth(ROBOT, Place(1.45, 1.63, math.pi / 2), world, "walls") == pytest.approx(0.03)


def test_there_is_a_depth_exactly_where_the_clearance_is_zero() -> None:
    rng = np.random.default_rng(5)
    met = 0
    for x, y, heading in rng.uniform((0.0, -2.0, -3.0), (3.0, 2.0, 3.0), (200, 3)).tolist():
        pose = Place(x, y, heading)
        gap, _ = clearance(ROBOT, pose, World("hall", (BOX,)), height=1.0)
        depth = overlap_depth(ROBOT, pose, WORLD, "box")
        assert (gap == 0.0) == (depth > 0.0)
        met += depth > 0.0
    assert 40 < met < 160
