"""Beams that a fan can skip: spans by hand, and scans bit for bit equal to those of every ray with every obstacle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom import Box, Cylinder, Place, Raster
from navloom_sensors_sim.beams import fan, fan_step
from navloom_sensors_sim.casting import NOTHING, Obstacles, cast_block, cast_fan, to_map
from navloom_sensors_sim.params import LaserSettings
from navloom_sensors_sim.scanners import LaserScanner, Moment
from navloom_sensors_sim.scene import Scene
from navloom_sensors_sim.sectors import beam_spans

TURN = 2.0 * math.pi
FANS = [(1, 2.0), (2, 1e-14), (3, TURN), (91, 1e-7), (181, math.pi), (257, TURN), (361, 1.5 * math.pi), (720, TURN)]


def spans(*obstacles, at=(0.0, 0.0, 0.3), reach=10.0):
    """(n, 4) spans of 360 beams, 1° apart, the first at -180°."""
    world = Scene(obstacles, None, sweeps=False).obstacles
    out = np.full((len(obstacles), 4), -7)
    beam_spans(np.array(at), -math.pi, math.radians(1.0), 360, reach, world, out)
    return out


def beams_met(*obstacles, **options):
    """Indices of the beams of the first obstacle's spans."""
    first, end, first_beyond, end_beyond = spans(*obstacles, **options)[0]
    return sorted({*range(first, end), *range(first_beyond, end_beyond)})


def test_cylinder_is_met_between_its_tangents():
    """Radius 1 m, 2 m ahead: 30° to either side, beams 150 to 210."""
    assert beams_met(Cylinder("c", 2.0, 0.0, 1.0)) == list(range(150, 211))


def test_box_is_met_between_the_corners_it_shows():
    """From its front: the near corners, at ±45°. From 1 mm below a corner: the next two, at 0.02° and 90°."""
    assert beams_met(Box("b", (1.0, 2.0), (-1.0, 1.0))) == list(range(135, 226))
    assert beams_met(Box("b", (0.0, 3.0), (0.0, 2.0)), at=(0.0, -1e-3, 0.3)) == list(range(181, 271))
    assert beams_met(Box("b", (1.0, 2.0), (1.0, 3.0)))[0] == 180 + 27  # arctan(1 / 2) = 26.6°
    assert beams_met(Box("b", (1.0, 2.0), (1.0, 3.0)))[-1] == 180 + 71  # arctan(3 / 1) = 71.6°


def test_turned_box_is_met_between_its_corners():
    """A square of half diagonal 1 m, turned by 45°, 2 m ahead: arctan(1 / 2) = 26.6° to either side."""
    h = math.sqrt(0.5)
    assert beams_met(Box("b", (2.0 - h, 2.0 + h), (-h, h), yaw=math.pi / 4)) == list(range(154, 207))


def test_sector_that_the_first_beam_cuts_is_met_at_both_ends():
    """Behind, 30° to either side of beam 0."""
    assert beams_met(Cylinder("c", -2.0, 0.0, 1.0)) == [*range(31), *range(330, 360)]


@pytest.mark.parametrize(
    "obstacle",
    [
        Cylinder("beyond the reach", 12.1, 0.0, 2.0),
        Box("beyond the reach", (8.0, 9.0), (7.0, 8.0)),  # its corner is 10.6 m away
        Cylinder("below", 2.0, 0.0, 1.0, (0.0, 0.29)),
        Box("above", (1.0, 2.0), (-1.0, 1.0), (0.31, 1.0)),
        Box("not there yet", (1.0, 2.0), (-1.0, 1.0), appears_at=1.0),
        Cylinder("not there yet", 2.0, 0.0, 1.0, appears_at=1.0),
    ],
    ids=lambda obstacle: f"{type(obstacle).__name__} {obstacle.name}",
)
def test_obstacles_that_no_beam_can_meet_have_no_span(obstacle):
    scene = Scene((obstacle,), None, sweeps=False)
    scene.update(0.0, swept=False)
    out = np.full((1, 4), -7)
    beam_spans(np.array([0.0, 0.0, 0.3]), -math.pi, math.radians(1.0), 360, 10.0, scene.obstacles, out)
    assert out.tolist() == [[0, 0, 0, 0]]


@pytest.mark.parametrize(
    "obstacle", [Cylinder("c", 0.5, 0.5, 1.0), Cylinder("touching", 1.0, 0.0, 1.0), Box("b", (-1.0, 3.0), (0.0, 1.0))]
)
def test_every_beam_meets_what_the_sensor_is_in(obstacle):
    assert beams_met(obstacle) == list(range(360))


def random_obstacles(rng, place, bearings, reach):
    """Rows of boxes and cylinders: near, around the sensor, touching and tangent, at the reach, level with the plane.

    Some have their heights or sides exchanged, which the intersection handles like any other.
    """
    boxes, cylinders = np.zeros((16, 9)), np.zeros((48, 6))
    for rows, size in ((boxes, 2), (cylinders, 1)):
        n = len(rows)
        rows[:, 2 : 2 + size] = rng.choice([0.0, 0.05, 0.05, 0.5, -0.5], (n, size)) * rng.uniform(0.5, 1.0, (n, 1))
        half = np.abs(rows[:, 2])
        # Dead ahead of a beam, or off it by the half size, so that the beam grazes; else anywhere.
        toward = np.where(rng.random(n) < 0.7, rng.choice(bearings, n), rng.uniform(-math.pi, math.pi, n))
        beside = rng.choice([0.0, -1.0, 1.0, 1.0 + 1e-15], n) * half
        away = np.select(
            [rng.random(n) < p for p in (0.01, 0.01, 0.1, 0.05)],
            [half, half * rng.random(n), reach + half, half + 10.0 ** rng.uniform(-15, -3, n)],
            rng.uniform(0.0, 1.5 * reach, n),
        )
        rows[:, 0] = place[0] + away * np.cos(toward) - beside * np.sin(toward)
        rows[:, 1] = place[1] + away * np.sin(toward) + beside * np.cos(toward)
        low = rng.choice([0.0, 0.3, 0.31], n, p=[0.8, 0.1, 0.1])
        rows[:, 2 + size], rows[:, 3 + size] = low, rng.choice([0.29, 0.3, 2.4], n, p=[0.1, 0.1, 0.8])
        rows[:, -1] = rng.random(n) < 0.95
    yaw = rng.choice([0.0, math.pi / 2, rng.uniform(-3.0, 3.0), rng.choice(bearings)], len(boxes))
    boxes[:, 6], boxes[:, 7] = np.cos(yaw), np.sin(yaw)
    return boxes, cylinders


def random_raster(rng, chance):
    """Arrays of a sparse raster, or of none."""
    if rng.random() >= chance:
        return np.zeros((0, 0), np.float32), np.zeros(7)
    raster = Raster("r", rng.random((40, 40)) < 0.01, 0.3, Place(*rng.uniform(-8.0, -4.0, 2), rng.uniform(-3, 3)))
    obstacles = Scene((), raster, sweeps=False).obstacles
    return obstacles.gaps, obstacles.raster


@pytest.mark.parametrize("count, field_of_view", FANS)
def test_fan_agrees_with_every_ray_against_every_obstacle(count, field_of_view):
    """Same ranges and indices to the last bit, in 60 difficult worlds."""
    rng = np.random.default_rng(count)
    met, inside = 0, 0
    for _ in range(60):
        base = np.array([*rng.choice([0.0, 1e5, *rng.uniform(-9, 9, 2)], 2), rng.choice([0.0, math.pi, rng.normal()])])
        base[2] += TURN * rng.integers(-3, 4)
        heading, reach = rng.choice([0.0, -math.pi, rng.uniform(-3, 3)]), rng.choice([2.0, 10.0, 30.0])
        bearings = fan(count, field_of_view, heading)
        mount = np.repeat([[rng.choice([0.0, 0.2])], [0.1], [0.3]], count, axis=1)
        beams = np.stack([np.cos(bearings), np.sin(bearings), np.zeros(count)])
        starts, ways = np.empty((3, count)), np.empty((3, count))
        to_map(*base, mount, True, starts)
        to_map(*base, beams, False, ways)
        rows = random_obstacles(rng, starts[:, 0], base[2] + bearings, reach)
        obstacles = Obstacles(*rows, *random_raster(rng, 0.2))
        ranges, hits = np.empty((2, count)), np.empty((2, count), np.int64)
        cast_block(starts, ways, obstacles, False, reach, ranges[0], hits[0])
        step = fan_step(count, field_of_view)
        cast_fan(starts, ways, base[2] + bearings[0], step, obstacles, reach, ranges[1], hits[1])
        np.testing.assert_array_equal(hits[1], hits[0])
        np.testing.assert_array_equal(ranges[1].view(np.int64), ranges[0].view(np.int64))
        met += np.count_nonzero(ranges[0] > 0.0) - np.count_nonzero(hits[0] == NOTHING)
        inside += bool(ranges[0].min() == 0.0)
    assert met > count and inside > 3


@pytest.mark.parametrize(
    "settings",
    [
        {"beams": 361, "field_of_view_deg": 270.0},
        {"beams": 500, "field_of_view_deg": 360.0, "heading_deg": 180.0},
        {"beams": 1, "field_of_view_deg": 10.0, "heading_deg": -90.0},
        {"beams": 10_000, "field_of_view_deg": 90.0, "x": 0.3},
    ],
    ids=lambda settings: f"{settings['beams']} beams",
)
def test_scan_agrees_with_every_ray_against_every_obstacle(settings):
    """As `LaserScanner` puts its fan together, among 150 posts and the noise left out."""
    rng = np.random.default_rng(3)
    settings = LaserSettings(noise=False, range_min=0.1, range_max=8.0, **settings)
    cylinders = np.column_stack([rng.uniform(-6, 6, (150, 2)), np.full((150, 3), [0.2, 0.0, 1.0]), np.ones(150)])
    obstacles = Obstacles(np.zeros((0, 9)), cylinders, np.zeros((0, 0), np.float32), np.zeros(7))
    scanner = LaserScanner(settings, np.zeros((0, 2)), np.random.default_rng(0), 0.05)
    for heading in (0.0, 2.5, -math.pi):
        base = np.array([0.5, -0.5, heading])
        _, places, bearings, *_, ranges, _, _ = scanner.read(Moment(0, 0, 0, base, None, obstacles, obstacles, 0))
        count = len(bearings)
        starts, ways = np.empty((3, count)), np.empty((3, count))
        true, hits = np.empty(count), np.empty(count, np.int64)
        to_map(*base, np.vstack([places.T, np.full(count, settings.z)]), True, starts)
        to_map(*base, np.stack([np.cos(bearings), np.sin(bearings), np.zeros(count)]), False, ways)
        cast_block(starts, ways, obstacles, False, settings.range_max, true, hits)
        np.testing.assert_array_equal(ranges, np.maximum(true, settings.range_min))
        assert np.isfinite(ranges).any()
