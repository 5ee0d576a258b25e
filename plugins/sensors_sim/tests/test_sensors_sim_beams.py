"""The planar laser and the ring of sonars."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom import Box, Cylinder
from navloom_sensors_sim.beams import _reading, cone_rays, fan, read_cones, ring_mounts
from navloom_sensors_sim.scene import Scene

WALL = Box("wall", (2.4, 2.6), (-20.0, 20.0))
INF = math.inf


def ring(**settings):
    return (("sonars", "sonar_ring", {"noise": False} | settings),)


def laser(**settings):
    return (("laser", "laser_2d", {"noise": False} | settings),)


def test_fan_runs_from_right_to_left():
    assert np.degrees(fan(5, math.pi, 0.0)) == pytest.approx([-90.0, -45.0, 0.0, 45.0, 90.0])


def test_full_circle_has_no_beam_twice():
    assert np.degrees(fan(4, 2.0 * math.pi, 0.0)) == pytest.approx([-180.0, -90.0, 0.0, 90.0])


def test_single_beam_looks_ahead():
    assert fan(1, math.pi, 0.5) == pytest.approx([0.5])


def test_p3dx_ring_on_a_square(footprint):
    """Direction 9.2° meets the front at y = 0.4 tan 9.2°; 63.1° meets the left side at x = 0.4 / tan 63.1°."""
    places, bearings, closed = ring_mounts("p3dx", footprint)
    assert np.degrees(bearings) == pytest.approx([90, 50, 30, 10, -10, -30, -50, -90])
    assert places[3] == pytest.approx([0.4, 0.4 * math.tan(math.radians(9.2))], abs=1e-12)
    assert places[0] == pytest.approx([0.4 / math.tan(math.radians(63.1)), 0.4], abs=1e-12)
    assert not closed


def test_pairs_ring_on_a_square(footprint):
    places, bearings, closed = ring_mounts("pairs", footprint)
    expected = [[0.4, -0.2], [0.4, 0.2], [0.2, 0.4], [-0.2, 0.4], [-0.4, 0.2], [-0.4, -0.2], [-0.2, -0.4], [0.2, -0.4]]
    assert places == pytest.approx(np.array(expected), abs=1e-12)
    assert np.degrees(bearings) == pytest.approx([0, 0, 90, 90, -180, -180, -90, -90])
    assert closed


def test_cone_rays_stay_inside_the_cone():
    half = math.radians(15.0)
    _, directions = cone_rays(np.array([[0.4, 0.0]]), np.array([0.3]), 0.25, half, 13, 13)
    axis = np.array([math.cos(0.3), math.sin(0.3), 0.0])
    assert np.degrees(np.arccos(np.clip(axis @ directions, -1, 1))).max() <= 15.01
    assert np.degrees(np.arcsin(directions[2])).max() == pytest.approx(15.0)
    assert 100 < directions.shape[1] < 169


def test_ring_before_a_wall(bench):
    """The wall is 2 m before the front. Cones of ±10° hold a ray straight at it, of ±30° one at 15°, of ±50° at 35°."""
    ranges = bench(sensors=ring(), obstacles=(WALL,)).first.scans["sonars"].ranges
    corner = (2.4 - 0.4 / math.tan(math.radians(46.2))) / math.cos(math.radians(35.0))
    aslant = 2.0 / math.cos(math.radians(15.0))
    expected = [INF, corner, aslant, 2.0, 2.0, aslant, corner, INF]
    assert ranges == pytest.approx(np.array(expected), abs=1e-9)


def test_smooth_wall_gives_no_echo_beyond_the_critical_angle(bench):
    ranges = bench(sensors=ring(critical_angle_deg=20.0), obstacles=(WALL,)).first.scans["sonars"].ranges
    aslant = 2.0 / math.cos(math.radians(15.0))
    assert ranges == pytest.approx(np.array([INF, INF, aslant, 2.0, 2.0, aslant, INF, INF]), abs=1e-9)


def test_round_post_echoes_where_it_faces_the_sonar(bench):
    """Any ray through the axis meets a cylinder head on, so the critical angle does not silence it."""
    post = Cylinder("post", 2.0, 0.0648, 0.1)
    ranges = bench(sensors=ring(critical_angle_deg=5.0), obstacles=(post,)).first.scans["sonars"].ranges
    assert ranges[3] == pytest.approx(1.5, abs=1e-3)


def test_pairs_before_a_wall(bench):
    ranges = bench(sensors=ring(layout="pairs"), obstacles=(WALL,)).first.scans["sonars"].ranges
    assert ranges == pytest.approx(np.array([2.0, 2.0, INF, INF, INF, INF, INF, INF]), abs=1e-9)


def test_nearer_than_range_min_reads_range_min(bench):
    near = Box("near", (0.5, 0.6), (-0.5, 0.5))
    assert bench(sensors=ring(layout="pairs"), obstacles=(near,)).first.scans["sonars"].ranges[0] == 0.3


def test_further_than_range_max_is_no_echo(bench):
    ranges = bench(sensors=ring(layout="pairs", range_max=1.9), obstacles=(WALL,)).first.scans["sonars"].ranges
    assert np.isinf(ranges).all()


def test_an_obstacle_below_the_axis_needs_vertical_spread(bench):
    """A 0.1 m high box 1.6 m before the front; a ray 15° down from 0.25 m meets its top, one level passes over it."""
    low = (Box("low", (1.0, 1.2), (-0.5, 0.5), (0.0, 0.1)),)
    assert np.isinf(bench(sensors=ring(layout="pairs"), obstacles=low).first.scans["sonars"].ranges[0])
    ranges = bench(sensors=ring(layout="pairs", rows=13), obstacles=low).first.scans["sonars"].ranges
    assert ranges[0] == pytest.approx(0.6 / math.cos(math.radians(15.0)), abs=1e-9)


def test_the_floor_echoes_only_if_configured(bench):
    """15° down from 0.25 m the floor is 0.25 / sin 15° = 0.966 m away."""
    assert np.isinf(bench(sensors=ring(rows=13)).first.scans["sonars"].ranges).all()
    ranges = bench(sensors=ring(rows=13, floor_echoes=True)).first.scans["sonars"].ranges
    assert ranges == pytest.approx(np.full(8, 0.25 / math.sin(math.radians(15.0))), abs=1e-9)


@pytest.mark.parametrize("which, victim", [(0.2, 0), (0.8, 1)])
def test_crosstalk_shortens_one_of_two_neighbours(which, victim, footprint):
    """Half way between range_min 0.3 and the true 2.0 m is 1.15 m; other pairs have no crosstalk."""
    places, bearings, closed = ring_mounts("pairs", footprint)
    rays = cone_rays(places, bearings, 0.25, 0.26, 13, 1)
    uniforms = np.ones((8, 3))
    uniforms[0] = 0.0, which, 0.5
    ranges, options = np.empty(8), np.array([0.3, 4.0, 0.0, -1.0, 0.1, 0.0])
    world = Scene([WALL], None, sweeps=False).obstacles
    read_cones(np.zeros(3), *rays, world, options, closed, np.zeros(8), uniforms, ranges)
    expected = [2.0, 2.0] + [INF] * 6
    expected[victim] = 1.15
    assert ranges == pytest.approx(np.array(expected), abs=1e-9)


def test_crosstalk_has_the_configured_probability(bench):
    """Seven pairs of a p3dx ring without echoes, 0.1 each: 700 false readings in 1000 rings, less coincidences."""
    robot = bench(sensors=(("sonars", "sonar_ring", {"crosstalk": 0.1}),))
    false = sum(np.isfinite(robot.step().scans["sonars"].ranges).sum() for _ in range(1000))
    assert 600 < false < 760


def test_range_noise_has_the_configured_spread(bench):
    robot = bench(
        sensors=(("laser", "laser_2d", {"sigma": 0.02, "beams": 100, "field_of_view_deg": 1.0}),), obstacles=(WALL,)
    )
    ranges = np.concatenate([robot.step().scans["laser"].ranges for _ in range(50)])
    assert (np.mean(ranges), np.std(ranges)) == pytest.approx((2.4, 0.02), rel=0.05)


def test_laser_mount(bench):
    """Mounted 0.3 m ahead, 0.1 m left, looking left: 2 m wall at the left is 1.9 m away, its beam points at +90°."""
    side = Box("side", (-5.0, 5.0), (2.0, 2.2))
    scan = bench(
        sensors=laser(x=0.3, y=0.1, heading_deg=90.0, beams=3, field_of_view_deg=90.0), obstacles=(side,)
    ).first
    scan = scan.scans["laser"]
    assert scan.ranges == pytest.approx(1.9 * np.array([math.sqrt(2), 1.0, math.sqrt(2)]), abs=1e-9)
    assert np.degrees(scan.bearings) == pytest.approx([45.0, 90.0, 135.0])
    assert scan.origins[1] == pytest.approx([0.3, 0.1])


def test_a_laser_does_not_see_obstacles_below_its_plane(bench):
    low = Box("low", (1.0, 1.2), (-5.0, 5.0), (0.0, 0.29))
    assert np.isinf(bench(sensors=laser(), obstacles=(low,)).first.scans["laser"].ranges).all()


def test_rate_leaves_ticks_out(bench):
    robot = bench(sensors=laser(rate_hz=5.0))
    due = ["laser" in robot.step().scans for _ in range(8)]
    assert due == [False, False, False, True, False, False, False, True]


@pytest.mark.parametrize(("error", "is_echo"), [(0.0, True), (0.09, True), (0.1, False), (0.2, False)])
def test_noise_that_reaches_range_max_leaves_no_echo(error, is_echo):
    reading = _reading(3.9, error, 0.3, 4.0)
    assert math.isfinite(reading) == is_echo and reading != 4.0
    assert _reading(0.31, -0.2, 0.3, 4.0) == 0.3
