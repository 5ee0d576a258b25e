"""Speed as ratios within one run, relative to MuJoCo's rays on the same obstacles."""

from __future__ import annotations

import math
import timeit

import mujoco
import numpy as np
import pytest
from navloom_sensors_sim.beams import cone_rays, fan, fan_step, read_cones, ring_mounts
from navloom_sensors_sim.casting import Obstacles, cast_block, cast_fan
from navloom_sensors_sim.motion import STATE, drive_tick
from navloom_sensors_sim.warming import warm_up

pytestmark = pytest.mark.benchmark


def best(call, number):
    """Shortest duration of a call in seven batches, s."""
    call()
    return min(timeit.repeat(call, number=number, repeat=7)) / number


def rays(rng, count):
    directions = rng.normal(size=(count, 3)) * [1.0, 1.0, 0.3]
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def mujoco_cast(model, data, directions):
    """A call that casts all rays from one point with mj_multiRay."""
    count = len(directions)
    hits, distances, flat = np.zeros(count, np.int32), np.zeros(count), directions.ravel()
    origin = np.array([0.0, 0.0, 0.4])
    return lambda: mujoco.mj_multiRay(model, data, origin, flat, None, 1, -1, hits, distances, None, count, 1e10)


@pytest.mark.parametrize("boxes, cylinders", [(50, 0), (25, 25)])
def test_a_sweep_of_rays_takes_less_than_half_of_mujocos_time(benchmark, mujoco_world, boxes, cylinders):
    rng = np.random.default_rng(0)
    model, data, ours = mujoco_world(rng, boxes, cylinders)
    directions = rays(rng, 9494)
    origins, ways = np.tile([[0.0], [0.0], [0.4]], (1, 9494)), np.ascontiguousarray(directions.T)
    ranges, hits = np.empty(9494), np.empty(9494, np.int64)
    warm_up()

    def cast():
        cast_block(origins, ways, ours, False, math.inf, ranges, hits)

    benchmark(cast)
    ratio = best(mujoco_cast(model, data, directions), 5) / best(cast, 5)
    benchmark.extra_info["times faster than mj_multiRay"] = round(ratio, 2)
    assert ratio > 2.0


def test_a_planar_scan_among_posts_takes_less_than_a_quarter_of_every_ray_against_every_post(benchmark):
    """361 beams over 270° and 300 posts within 5 m, as in the worlds of BARN."""
    rng = np.random.default_rng(0)
    posts = np.column_stack([rng.uniform(-5, 5, (300, 2)), np.full((300, 4), [0.075, 0.0, 1.0, 1.0])])
    obstacles = Obstacles(np.zeros((0, 9)), posts, np.zeros((0, 0), np.float32), np.zeros(7))
    bearings, step = fan(361, 1.5 * math.pi, 0.0), fan_step(361, 1.5 * math.pi)
    origins = np.repeat([[0.0], [0.0], [0.3]], 361, axis=1)
    beams = np.stack([np.cos(bearings), np.sin(bearings), np.zeros(361)])
    ranges, hits = np.empty(361), np.empty(361, np.int64)
    warm_up()

    def scan():
        cast_fan(origins, beams, bearings[0], step, obstacles, 10.0, ranges, hits)

    benchmark(scan)
    every = best(lambda: cast_block(origins, beams, obstacles, False, 10.0, ranges, hits), 30)
    ratio = every / best(scan, 100)
    benchmark.extra_info["times faster than every ray against every post"] = round(ratio, 2)
    assert ratio > 4.0


def test_a_whole_tick_takes_less_than_mujoco_takes_for_its_sonars(benchmark, mujoco_world, footprint):
    """Drive, odometry, contact and 8 sonars of 13 rays against 12 boxes; MuJoCo casts the 104 rays alone."""
    rng = np.random.default_rng(0)
    model, data, ours = mujoco_world(rng, 12, 0)
    places, bearings, closed = ring_mounts("p3dx", footprint)
    origins, ways = cone_rays(places, bearings, 0.25, math.radians(15.0), 13, 1)
    state, track = np.zeros(len(STATE)), np.zeros((6, 6))
    drive = np.array([0.05, 0.3, 0.05, 0.3, 20.0, 0.1, math.inf, 0.05])
    odometry, command, slip = np.array([0.05, 0.05, 0.3, 0.002, 0.0]), np.array([0.3, 0.4]), np.zeros(2)
    options, normals, uniforms = np.array([0.3, 4.0, 0.01, 0.5, 0.01, 0.0]), np.zeros(8), np.ones((8, 3))
    ranges = np.empty(8)
    warm_up()

    def tick():
        drive_tick(state, track, drive, odometry, command, slip, footprint, 1.2, ours)
        read_cones(state, origins, ways, ours, options, closed, normals, uniforms, ranges)

    benchmark(tick)
    ratio = best(mujoco_cast(model, data, rays(rng, 104)), 300) / best(tick, 300)
    benchmark.extra_info["times faster than mj_multiRay's 104 rays alone"] = round(ratio, 2)
    assert ratio > 1.0
