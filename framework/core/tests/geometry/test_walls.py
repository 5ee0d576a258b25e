import math

import numpy as np
import pytest
from navloom.geometry.walls import walls_of
from navloom.geometry.world import Box, Cylinder, Place, Raster, World


def test_a_box_has_four_walls_and_a_girder_none() -> None:
    world = World("w", (Box("b", (0.0, 2.0), (0.0, 1.0)), Box("girder", (0.0, 2.0), (3.0, 4.0), (2.0, 2.4))))
    lines = walls_of(world)
    assert len(lines) == 4
    assert np.hypot(*(lines[:, 2:] - lines[:, :2]).T).tolist() == pytest.approx([2.0, 1.0, 2.0, 1.0])


def test_the_walls_about_a_cylinder_touch_it() -> None:
    lines = walls_of(World("w", (Cylinder("c", 1.0, 2.0, 0.5),)))
    middles = 0.5 * (lines[:, :2] + lines[:, 2:]) - (1.0, 2.0)
    assert len(lines) == 8 and np.hypot(*middles.T) == pytest.approx(0.5)


def test_a_straight_rim_of_a_raster_is_one_wall() -> None:
    """An L of three cells of 0.5 m: six walls; its frame is turned by a quarter about (1, 0)."""
    cells = np.array([[True, True], [True, False]])
    lines = walls_of(World("w", raster=Raster("r", cells, 0.5, Place(1.0, 0.0, 0.5 * math.pi))))
    lengths = np.hypot(*(lines[:, 2:] - lines[:, :2]).T)
    assert sorted(lengths.tolist()) == pytest.approx([0.5, 0.5, 0.5, 0.5, 1.0, 1.0])
    assert lines[:, [0, 2]].max() == pytest.approx(1.0) and lines[:, [0, 2]].min() == pytest.approx(0.0)
