"""Rays on boxes, cylinders, floor and rasters: numbers by hand, and comparison with MuJoCo."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from navloom import Box, Cylinder, Place, Raster
from navloom_sensors_sim.casting import FLOOR, NOTHING, cast_rays
from navloom_sensors_sim.incidence import cosine_of_incidence
from navloom_sensors_sim.scene import Scene

AHEAD, UP, DOWN = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]


def scene(*obstacles, raster=None):
    return Scene(obstacles, raster, sweeps=False).obstacles


def cast(obstacles, origin, direction, floor=False):
    ranges, hits = cast_rays(np.array([origin], float), np.array([direction], float), obstacles, floor)
    return ranges[0], hits[0]


def test_box_ahead():
    assert cast(scene(Box("b", (2.0, 3.0), (-1.0, 1.0))), [0, 0, 1], AHEAD) == (2.0, 0)


def test_box_below_the_ray_is_missed():
    assert cast(scene(Box("b", (2.0, 3.0), (-1.0, 1.0), (0.0, 0.5))), [0, 0, 1], AHEAD) == (math.inf, NOTHING)


def test_box_behind_is_missed():
    assert cast(scene(Box("b", (-3.0, -2.0), (-1.0, 1.0))), [0, 0, 1], AHEAD) == (math.inf, NOTHING)


def test_ray_from_inside_hits_at_zero():
    assert cast(scene(Box("b", (-1.0, 1.0), (-1.0, 1.0))), [0, 0, 1], AHEAD) == (0.0, 0)


def test_square_turned_by_45_degrees_shows_its_corner():
    reach, _ = cast(scene(Box("b", (2.0, 4.0), (-1.0, 1.0), yaw=math.pi / 4)), [0, 0, 1], AHEAD)
    assert reach == pytest.approx(3.0 - math.sqrt(2.0), abs=1e-12)


def test_ray_in_the_plane_of_a_face():
    """Of two opposite faces the lower belongs to the box, so that of two boxes side by side exactly one is hit."""
    assert cast(scene(Box("b", (2.0, 3.0), (-1.0, 1.0))), [0, -1, 1], AHEAD) == (2.0, 0)
    assert cast(scene(Box("b", (2.0, 3.0), (-1.0, 1.0))), [0, 1, 1], AHEAD) == (math.inf, NOTHING)


def test_cylinder_ahead_and_aside():
    post = scene(Cylinder("c", 5.0, 0.0, 1.0))
    assert cast(post, [0, 0, 1], AHEAD) == (4.0, 0)
    assert cast(post, [0, 0.6, 1], AHEAD)[0] == pytest.approx(5.0 - 0.8, abs=1e-12)
    assert cast(post, [0, 1.001, 1], AHEAD) == (math.inf, NOTHING)


def test_cylinder_from_above_shows_its_end_face():
    assert cast(scene(Cylinder("c", 0.0, 0.0, 1.0, (0.0, 2.0))), [0.5, 0.5, 5.0], DOWN) == (3.0, 0)
    assert cast(scene(Cylinder("c", 0.0, 0.0, 1.0, (0.0, 2.0))), [0.8, 0.8, 5.0], DOWN) == (math.inf, NOTHING)


def test_floor_is_met_at_the_papers_slant():
    """0.4 m above the floor at -5°: 0.4 / sin 5° = 4.589 m."""
    low = math.radians(-5.0)
    reach, hit = cast(scene(), [0, 0, 0.4], [math.cos(low), 0.0, math.sin(low)], floor=True)
    assert (round(reach, 3), hit) == (4.589, FLOOR)


def test_floor_can_be_switched_off():
    assert cast(scene(), [0, 0, 0.4], DOWN, floor=False) == (math.inf, NOTHING)


def test_an_obstacle_out_of_reach_is_not_hit():
    world, origins, ways = (
        scene(Box("b", (2.0, 3.0), (-1.0, 1.0))),
        np.array([[0.0, 0.0, 1.0]] * 2),
        np.array([AHEAD, DOWN]),
    )
    for reach, expected in ((2.1, [2.0, 1.0]), (1.9, [math.inf, 1.0]), (0.9, [math.inf, math.inf])):
        assert list(cast_rays(origins, ways, world, True, reach)[0]) == expected


def test_leaving_out_what_is_out_of_reach_changes_no_bit():
    rng = np.random.default_rng(1)
    x, y, yaw = rng.uniform(-20.0, 20.0, 300), rng.uniform(-20.0, 20.0, 300), rng.uniform(-3.0, 3.0, 300)
    boxes = [Box(f"b{k}", (x[k], x[k] + 1.5), (y[k], y[k] + 0.3), yaw=yaw[k]) for k in range(150)]
    world = scene(*boxes, *(Cylinder(f"c{k}", x[k], y[k], 0.2) for k in range(150, 300)))
    turns = rng.uniform(-math.pi, math.pi, 400)
    origins = np.column_stack([rng.uniform(-1.0, 1.0, (400, 2)), np.full(400, 0.3)])
    ways = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(400)])
    everywhere, hits = cast_rays(origins, ways, world, False)
    near, near_hits = cast_rays(origins, ways, world, False, 5.0)
    assert 50 < (everywhere < 5.0).sum() < 350
    np.testing.assert_array_equal(near, np.where(everywhere < 5.0, everywhere, math.inf))
    np.testing.assert_array_equal(near_hits, np.where(everywhere < 5.0, hits, NOTHING))


def test_indices_run_over_boxes_cylinders_raster():
    wall = Raster("r", np.array([[True]]), 1.0, Place(-5.0, -0.5))
    world = scene(Box("a", (9.0, 10.0), (-1.0, 1.0)), Cylinder("c", 0.0, 5.0, 1.0), raster=wall)
    directions = [AHEAD, [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    ranges, hits = cast_rays(np.tile([0.0, 0.0, 1.0], (3, 1)), np.array(directions), world, False)
    assert (list(hits), list(ranges)) == ([0, 1, 2], [9.0, 4.0, 4.0])


def corridor():
    """Cells of 0.5 m, one wall column at x 5..5.5, walls 0..1 m high."""
    occupied = np.zeros((8, 20), bool)
    occupied[:, 10] = True
    return scene(raster=Raster("r", occupied, 0.5, Place(0.0, 0.0), (0.0, 1.0)))


def test_raster_wall():
    assert cast(corridor(), [1.0, 2.1, 0.5], AHEAD) == (4.0, 0)


def test_ray_over_a_raster_wall():
    assert cast(corridor(), [1.0, 2.1, 1.1], AHEAD) == (math.inf, NOTHING)


def test_rising_ray_leaves_the_raster_before_the_wall():
    """From 0.5 m high at 1 m ahead, the wall top is passed where 4 tan a = 0.5: a = 7.125°."""
    for degrees, hits in ((7.0, True), (7.25, False)):
        a = math.radians(degrees)
        reach, _ = cast(corridor(), [1.0, 2.1, 0.5], [math.cos(a), 0.0, math.sin(a)])
        assert math.isfinite(reach) == hits
        if hits:
            assert reach == pytest.approx(4.0 / math.cos(a), abs=1e-12)


def test_falling_ray_meets_the_top_of_a_raster_cell():
    """From 2 m high, 45° down, the height of 1 m is reached at x = 5.2, inside the wall's column."""
    h = math.sqrt(0.5)
    reach, hit = cast(corridor(), [4.2, 2.1, 2.0], [h, 0.0, -h])
    assert (reach, hit) == (pytest.approx(math.sqrt(2.0), abs=1e-12), 0)


def test_upright_ray_over_raster_cells():
    assert cast(corridor(), [5.2, 2.1, 3.0], DOWN) == (2.0, 0)
    assert cast(corridor(), [4.2, 2.1, 3.0], DOWN) == (math.inf, NOTHING)


def test_raster_is_entered_from_outside():
    assert cast(corridor(), [-3.0, 2.1, 0.5], AHEAD) == (8.0, 0)
    assert cast(corridor(), [-3.0, 2.1, 0.5], [-1.0, 0.0, 0.0]) == (math.inf, NOTHING)


@pytest.mark.parametrize("seed", range(6))
def test_raster_agrees_with_one_box_a_cell(seed):
    """A sparse turned raster, with leaps over free space, compared with its cells as boxes."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((40, 60)) < 0.02
    heading, cell = rng.uniform(-3, 3), 0.25
    place = Place(*rng.uniform(-5, 5, 2), heading)
    c, s = math.cos(heading), math.sin(heading)
    boxes = []
    for row, col in np.argwhere(occupied):
        u, v = (col + 0.5) * cell, (row + 0.5) * cell
        x, y = place.x + c * u - s * v, place.y + s * u + c * v
        boxes.append(Box("b", (x - cell / 2, x + cell / 2), (y - cell / 2, y + cell / 2), (0.2, 1.5), yaw=heading))
    raster = scene(raster=Raster("r", occupied, cell, place, (0.2, 1.5)))
    origins = np.column_stack([rng.uniform(-12, 12, (3000, 2)), rng.uniform(0, 2, 3000)])
    directions = rng.normal(size=(3000, 3)) * [1.0, 1.0, 0.1]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    by_cells, by_walk = cast_rays(origins, directions, scene(*boxes))[0], cast_rays(origins, directions, raster)[0]
    assert np.isfinite(by_walk).sum() > 500
    np.testing.assert_allclose(by_walk, by_cells, rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_ranges_hits_and_normals_agree_with_mujoco(seed, mujoco_world):
    rng = np.random.default_rng(seed)
    model, data, ours = mujoco_world(rng, 30, 20)
    count = 4000
    origin = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(0.2, 3.0)])
    directions = rng.normal(size=(count, 3)) * [1.0, 1.0, 0.3]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits, distances, normals = np.zeros(count, np.int32), np.zeros(count), np.zeros(3 * count)
    mujoco.mj_multiRay(model, data, origin, directions.ravel(), None, 1, -1, hits, distances, normals, count, 1e10)
    ranges, found = cast_rays(np.tile(origin, (count, 1)), directions, ours, floor=False)
    hit = distances >= 0.0
    assert hit.sum() > 500
    np.testing.assert_array_equal(found, np.where(hit, hits, NOTHING))
    np.testing.assert_allclose(ranges[hit], distances[hit], rtol=0, atol=1e-9)
    starts, ways = np.tile(origin[:, None], (1, count)), np.ascontiguousarray(directions.T)
    cosines = [cosine_of_incidence(starts, ways, i, ranges[i], found[i], ours) for i in np.flatnonzero(hit)]
    expected = np.abs(np.einsum("ij,ij->i", normals.reshape(-1, 3)[hit], directions[hit]))
    np.testing.assert_allclose(cosines, expected, rtol=0, atol=1e-6)
