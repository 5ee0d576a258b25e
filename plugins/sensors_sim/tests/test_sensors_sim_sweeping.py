"""The pitched laser: geometries, the paper's figures, time stamps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom import Box, Place
from navloom_sensors_sim.casting import FLOOR, NOTHING, cast_rays
from navloom_sensors_sim.motion import arc
from navloom_sensors_sim.scene import Scene
from navloom_sensors_sim.sweeping import frame_offsets_ns, sweep_directions

PITCHES = np.radians(-5.0 + 0.266 * np.arange(94))
BEARINGS = np.radians(np.arange(-50.0, 51.0))
FAR_WALL = Box("wall", (5.0, 5.2), (-40.0, 40.0), (0.0, 9.0))
NORTH = Place(0.0, 0.0, math.pi / 2)


def laser(**settings):
    return (("laser", "pitched_laser", {"noise": False} | settings),)


def test_eq_1_direction():
    """α = 30°, β = 60°, in eq. (1) x right, y ahead: so ahead cosα sinβ = 3/4, left -cosα cosβ = -0.433, up 1/2."""
    way = sweep_directions(np.radians([30.0]), np.radians([60.0 - 90.0]), "paper")[0, :, 0]
    assert way == pytest.approx([0.75, -math.sqrt(3) / 4, 0.5], abs=1e-12)


def test_rigid_pitch_direction():
    """x right = cosβ, ahead = sinβ cosα, up = sinβ sinα: (0.75, -0.5, 0.433) ahead, left, up."""
    way = sweep_directions(np.radians([30.0]), np.radians([60.0 - 90.0]), "rigid_pitch")[0, :, 0]
    assert way == pytest.approx([0.75, -0.5, math.sqrt(3) / 4], abs=1e-12)


@pytest.mark.parametrize("geometry", ["paper", "rigid_pitch"])
def test_directions_are_unit_vectors(geometry):
    assert np.linalg.norm(sweep_directions(PITCHES, BEARINGS, geometry), axis=1) == pytest.approx(1.0, abs=1e-12)


def test_eq_1_overstates_height_by_156_percent_at_the_edge():
    """DECISIONS: 1.56 times at β = 40°, that is 1 / sin 40°."""
    paper, rigid = (sweep_directions(PITCHES, BEARINGS, g)[50, 2, 0] for g in ("paper", "rigid_pitch"))
    assert paper / rigid == pytest.approx(1.0 / math.sin(math.radians(40.0)), abs=1e-9)


def test_frames_are_13_3_ms_apart():
    offsets = frame_offsets_ns(94, 1.25)
    assert (offsets[0], offsets[1], offsets[93]) == (0, 13_297_872, 1_236_702_128)


def test_hits_in_the_papers_world(paper_gates):
    """Girder A 230, girder B 177, floor 772, no return 1801 of 9494."""
    world = Scene(paper_gates, None, sweeps=True)
    ways = sweep_directions(PITCHES, BEARINGS, "paper").transpose(0, 2, 1).reshape(-1, 3)
    ways = np.column_stack([-ways[:, 1], ways[:, 0], ways[:, 2]])  # the robot faces +y
    _, hits = cast_rays(np.tile([0.0, 0.0, 0.4], (9494, 1)), ways, world.obstacles)
    counts = {name: int((hits == index).sum()) for index, name in enumerate(world.names)}
    assert (counts["girder A"], counts["girder B"]) == (230, 177)
    assert ((hits == FLOOR).sum(), (hits == NOTHING).sum()) == (772, 1801)


def test_sweep_message_of_the_papers_world(bench, paper_gates):
    robot = bench(sensors=laser(), obstacles=paper_gates, start=NORTH)
    assert "laser" not in robot.step(request=1, count=24).scans
    sweep = robot.step().scans["laser"]
    assert (sweep.stamp_ns, sweep.request_id, sweep.ranges.shape) == (0, 1, (94, 101))
    assert np.isinf(sweep.ranges).sum() == 1801
    assert round(sweep.ranges[0, 50], 3) == 4.589
    assert np.degrees([*sweep.pitches[[0, 93]], *sweep.bearings[[0, 100]]]) == pytest.approx(
        [-5.0, 19.738, -50.0, 50.0]
    )


def test_a_rigid_pitch_is_named_in_the_message_and_gives_another_image(bench, paper_gates):
    robot = bench(sensors=laser(geometry="rigid_pitch"), obstacles=paper_gates, start=NORTH)
    sweep = robot.step(request=1, count=25).scans["laser"]
    assert sweep.geometry == "rigid_pitch"
    assert sweep.ranges[0, 0] == pytest.approx(0.4 / (math.sin(math.radians(5.0)) * math.cos(math.radians(50.0))))


def test_there_is_no_sweep_without_a_request(bench):
    robot = bench(sensors=laser())
    assert not any(robot.step().scans for _ in range(60))


def test_sweep_begins_with_the_tick_of_its_request(bench):
    robot = bench(sensors=laser())
    robot.step(count=7)
    assert robot.step(request=4, count=25).scans["laser"].stamp_ns == 350_000_000


def test_request_with_the_first_call_is_answered(bench):
    """The first call is for time 0 and moves nothing: its request waits for the next one."""
    robot = bench(sensors=laser())
    robot.platform.reset()
    robot.ticks = -1
    robot.step(request=1)
    assert robot.step(count=25).scans["laser"].stamp_ns == 0


def test_a_newer_request_restarts_the_sweep(bench):
    robot = bench(sensors=laser())
    robot.step(request=1, count=10)
    assert not robot.step(request=2, count=24).scans
    sweep = robot.step().scans["laser"]
    assert (sweep.request_id, sweep.stamp_ns) == (2, 500_000_000)


def reconstruct(sweep, v, w):
    """Map points of all returns, each frame from the pose at its own stamp on the arc of a robot that started at 0."""
    ways = sweep_directions(sweep.pitches, sweep.bearings, sweep.geometry)
    points = []
    for time, way, ranges in zip(sweep.stamp_ns * 1e-9 + sweep.frame_times, ways, sweep.ranges, strict=True):
        x, y, heading = arc(0.0, 0.0, 0.0, v, w, time)
        c, s = math.cos(heading), math.sin(heading)
        local = way * ranges
        px, py = local[0] + sweep.x, local[1] + sweep.y
        points.append(np.stack([x + c * px - s * py, y + s * px + c * py, local[2] + sweep.z]))
    return np.concatenate(points, axis=1)


@pytest.mark.parametrize("geometry", ["paper", "rigid_pitch"])
def test_frames_are_taken_where_the_robot_was_at_their_stamps(bench, geometry):
    """Driving a curve while sweeping: with the frames' own stamps every return lies on the wall or on the floor."""
    settings = laser(mode="continuous", geometry=geometry, x=0.2, y=0.1)
    robot = bench({"noise": False}, settings, (FAR_WALL,))
    sweeps = [out.scans["laser"] for _ in range(50) if "laser" in (out := robot.step(0.4, 0.1)).scans]
    assert [s.stamp_ns for s in sweeps] == [0, 1_250_000_000]
    for sweep in sweeps:
        x, _, z = reconstruct(sweep, 0.4, 0.1)
        seen = np.isfinite(sweep.ranges).ravel()
        off = np.minimum(np.abs(x[seen] - 5.0), np.abs(z[seen]))
        assert off.max() < 1e-6
        assert (np.abs(x[seen] - 5.0) < 1e-6).sum() > 5000


def test_continuous_sweeps_go_up_and_down_in_turn(bench):
    robot = bench(sensors=laser(mode="continuous"))
    sweeps = [out.scans["laser"] for _ in range(75) if "laser" in (out := robot.step()).scans]
    assert [s.request_id for s in sweeps] == [0, 0, 0]
    assert [round(math.degrees(s.pitches[0]), 3) for s in sweeps] == [-5.0, 19.738, -5.0]


def test_continuous_sweep_that_begins_after_a_request_answers_it(bench):
    robot = bench(sensors=laser(mode="continuous"))
    robot.step(count=5)
    robot.step(request=3)
    sweeps = [out.scans["laser"] for _ in range(70) if "laser" in (out := robot.step()).scans]
    assert [s.request_id for s in sweeps] == [0, 3, 0]


def test_the_systematic_error_is_one_number_for_each_run(bench):
    settings = (("laser", "pitched_laser", {"sigma": 0.0, "systematic": 0.035}),)
    biases = []
    for seed in range(20):
        robot = bench(sensors=settings, obstacles=(FAR_WALL,), seed=seed)
        first, second = (robot.step(request=k, count=25).scans["laser"].ranges for k in (1, 2))
        exact = bench(sensors=laser(), obstacles=(FAR_WALL,)).step(request=1, count=25).scans["laser"].ranges
        seen = np.isfinite(exact)
        assert np.ptp(first[seen] - exact[seen]) < 1e-9
        np.testing.assert_array_equal(first, second)
        biases.append((first[seen] - exact[seen])[0])
    assert max(np.abs(biases)) <= 0.035
    assert np.ptp(biases) > 0.035


def test_sigma_is_10_mm(bench):
    exact = bench(sensors=laser(), obstacles=(FAR_WALL,)).step(request=1, count=25).scans["laser"].ranges
    settings = (("laser", "pitched_laser", {}),)
    noisy = bench(sensors=settings, obstacles=(FAR_WALL,)).step(request=1, count=25).scans["laser"].ranges
    seen = np.isfinite(exact)
    assert np.std((noisy - exact)[seen]) == pytest.approx(0.01, rel=0.05)


def test_obstacle_appears_after_the_first_sweep_has_ended(bench):
    """Only from the tick after the one that completed the sweep, so that no frame sees it.

    Straight ahead the floor alone is seen: by the 18 frames that look down by more than asin(0.4 / 80) = 0.286°.
    """
    late = Box("O", (1.0, 1.3), (-0.15, 0.15), (0.0, 0.5), appears_after_sweep=True)
    robot = bench(sensors=laser(), obstacles=(late,))
    assert robot.step(count=40).truth.nearest == ""
    out = robot.step(request=1, count=25)
    assert (out.truth.nearest, np.isfinite(out.scans["laser"].ranges[:, 50]).sum()) == ("", 18)
    assert robot.step().truth.nearest == "O"


def test_without_a_pitched_laser_obstacles_that_appear_after_its_sweep_exist_from_the_start(bench):
    late = Box("O", (1.0, 1.3), (-0.15, 0.15), appears_after_sweep=True)
    assert bench(obstacles=(late,)).first.truth.nearest == "O"
