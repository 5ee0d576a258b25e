"""The whole platform: noise switches, random draws, invariance, settings, errors."""

from __future__ import annotations

import math
from importlib.metadata import entry_points

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom import Box, Cylinder, InputError, Place, RangeScan, Raster, Registry, SensorSpec, Sweep
from navloom.testing import context, make, platform_input
from navloom_sensors_sim.adapter import SensorsSim
from navloom_sensors_sim.beams import read_cones, read_laser
from navloom_sensors_sim.casting import cast_block
from navloom_sensors_sim.clearance import clearance_at
from navloom_sensors_sim.motion import drive_tick
from navloom_sensors_sim.params import LaserSettings, PitchedLaserSettings, SensorsSimParams, SonarSettings
from navloom_sensors_sim.sweeping import read_frames
from pydantic import ValidationError

SENSORS = (
    ("sweeper", "pitched_laser", {"mode": "continuous", "systematic": 0.035}),
    ("laser", "laser_2d", {}),
    ("sonars", "sonar_ring", {"crosstalk": 0.05, "critical_angle_deg": 60.0}),
)
QUIET = tuple((name, kind, given | {"noise": False}) for name, kind, given in SENSORS)
CLUTTER = (
    Box("wall", (2.0, 2.3), (-3.0, 3.1), (0.0, 1.7), yaw=0.2),
    Box("crate", (-1.7, -1.1), (0.9, 1.4), (0.0, 0.8)),
    Cylinder("post", 0.3, 1.9, 0.17),
)


def drive(robot, ticks=30):
    """All measurements on a curve: odometry and ranges of all sensors, in one row."""
    parts = []
    for _ in range(ticks):
        out = robot.step(0.3, 0.2)
        parts += [[out.odometry.pose.x, out.odometry.pose.y, out.odometry.pose.heading]]
        parts += [scan.ranges.ravel() for _, scan in sorted(out.scans.items())]
    return np.concatenate(parts)


def test_messages_by_kind(bench):
    out = bench(sensors=SENSORS).step(count=25)
    assert {name: type(scan) for name, scan in out.scans.items()} == {
        "sweeper": Sweep,
        "laser": RangeScan,
        "sonars": RangeScan,
    }
    assert out.odometry.stamp_ns == out.scans["laser"].stamp_ns == 1_250_000_000


def test_a_kind_that_a_subclass_adds_is_left_to_it():
    class WithGas(SensorsSim):
        sensor_kinds = {**SensorsSim.sensor_kinds, "gas": RangeScan}

    sensors = [SensorSpec("laser", "laser_2d"), SensorSpec("nose", "gas", {"x": 1.0})]
    assert list(make(WithGas, context(sensors=sensors)).advance(platform_input()).scans) == ["laser"]


def test_same_seed_same_run(bench):
    one, two = (drive(bench({"slip": 0.01}, SENSORS, CLUTTER, seed=3)) for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_other_seed_other_noise(bench):
    one, two = (drive(bench({"slip": 0.01}, SENSORS, CLUTTER, seed=s)) for s in (3, 4))
    assert np.mean(one != two) > 0.3


def test_without_noise_two_seeds_agree(bench):
    one, two = (drive(bench({"noise": False, "slip": 0.01}, QUIET, CLUTTER, seed=s)) for s in (3, 4))
    np.testing.assert_array_equal(one, two)


def test_reset_restarts_the_run(bench):
    robot = bench({"noise": False, "motor_time_constant": 0.1}, QUIET, CLUTTER)
    one = drive(robot)
    robot.platform.reset()
    robot.ticks = -1
    robot.step()
    np.testing.assert_array_equal(drive(robot), one)


def test_every_stream_gives_the_same_count_whatever_the_scene(bench):
    """The next draw of each stream is the same after an empty world, a full one and one that touches."""
    around = (Box("around", (-9.0, 9.0), (-9.0, 9.0)),)
    robots = [bench({}, SENSORS, world, seed=5) for world in ((), CLUTTER, around)]
    for robot in robots:
        drive(robot)
    draws = [{name: stream.random() for name, stream in robot.streams.items()} for robot in robots]
    assert set(draws[0]) == {"sweeper", "laser", "sonars", "odometry"}
    assert draws[0] == draws[1] == draws[2]


def test_sweep_requests_do_not_shift_later_noise(bench):
    """A sweep's noise depends on the tick it begins in, not on the sweeps before it."""
    sensors, world = (("sweeper", "pitched_laser", {}),), (Box("wall", (3.0, 3.2), (-9.0, 9.0)),)
    often, once = bench(sensors=sensors, obstacles=world), bench(sensors=sensors, obstacles=world)
    often.step(request=1, count=30)
    once.step(count=30)
    one, two = (robot.step(request=2, count=25).scans["sweeper"].ranges for robot in (often, once))
    np.testing.assert_array_equal(one, two)


def test_a_repeated_request_lets_the_running_sweep_continue_and_a_new_one_restarts_it(bench):
    sensors = (("sweeper", "pitched_laser", {}),)  # 1.25 s, so 25 ticks

    def after_10_ticks(request):
        robot = bench(sensors=sensors)
        robot.step(request=7, count=10)
        return robot.step(request=request, count=15).scans

    assert after_10_ticks(7)["sweeper"].request_id == 7
    assert after_10_ticks(8) == {}


def test_a_repeated_request_for_a_sweep_that_has_ended_makes_another(bench):
    robot = bench(sensors=(("sweeper", "pitched_laser", {}),))
    first, second = (robot.step(request=7, count=25).scans["sweeper"] for _ in range(2))
    assert second.request_id == 7 and second.stamp_ns > first.stamp_ns


def turned(obstacle, angle, dx, dy):
    """The obstacle after the world was turned about the origin and moved."""
    cx, cy = obstacle.centre
    x, y = dx + math.cos(angle) * cx - math.sin(angle) * cy, dy + math.sin(angle) * cx + math.cos(angle) * cy
    if isinstance(obstacle, Cylinder):
        return Cylinder(obstacle.name, x, y, obstacle.radius, obstacle.z)
    hx, hy = 0.5 * (obstacle.x[1] - obstacle.x[0]), 0.5 * (obstacle.y[1] - obstacle.y[0])
    return Box(obstacle.name, (x - hx, x + hx), (y - hy, y + hy), obstacle.z, obstacle.yaw + angle)


@settings(max_examples=25, deadline=None)
@given(angle=st.floats(-3.1, 3.1), dx=st.floats(-50, 50), dy=st.floats(-50, 50))
def test_turning_world_and_robot_changes_no_reading(bench, angle, dx, dy):
    here = drive(bench({}, SENSORS, CLUTTER), 26)
    there = drive(bench({}, SENSORS, tuple(turned(o, angle, dx, dy) for o in CLUTTER), None, Place(dx, dy, angle)), 26)
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-7)


def test_new_parameters_leave_the_robot_where_it_is(bench):
    """0.4 m, then 0.42 m more with wheels 5 % larger."""
    robot = bench({"noise": False})
    robot.step(0.4, count=20)
    robot.platform.configure(SensorsSimParams(noise=False, wheel_radius_error=0.05))
    assert robot.step(0.4, count=20).truth.pose.x == pytest.approx(0.82, abs=1e-12)


@pytest.mark.parametrize(
    "kind, settings, asked",
    [
        ("pitched_laser", {}, True),
        ("pitched_laser", {"mode": "on_request"}, True),
        ("pitched_laser", {"mode": "continuous"}, False),
        ("laser_2d", {}, False),
        ("sonar_ring", {}, False),
    ],
)
def test_which_sensors_measure_on_request_only(kind, settings, asked):
    assert SensorsSim.scans_on_request(SensorSpec("eye", kind, settings)) is asked


def test_registers_by_its_entry_point():
    (entry,) = (e for e in entry_points(group="navloom") if e.name == "platform.sensors_sim")
    registry = Registry()
    entry.load().navloom_register(registry)
    assert registry.roles == {("platform", "sensors_sim"): SensorsSim}


def test_no_tick_compiles(bench):
    """After `warm_up` no kernel meets a new type, whatever is simulated, and also with a read-only footprint."""
    SensorsSim.warm_up()
    kernels = (cast_block, read_laser, read_cones, read_frames, drive_tick, clearance_at)
    before = [len(kernel.signatures) for kernel in kernels]
    raster = Raster("r", np.eye(9, dtype=bool), 0.5, Place(4.0, 4.0))
    robot = bench({"slip": 0.01, "motor_time_constant": 0.1, "encoder_counts": 500}, SENSORS, CLUTTER, raster)
    robot.step(0.2, 0.1, count=60)
    assert [len(kernel.signatures) for kernel in kernels] == before


@pytest.mark.parametrize("kind", [SensorsSimParams, PitchedLaserSettings, LaserSettings, SonarSettings])
def test_unknown_keys_are_refused_and_every_field_says_what_it_is(kind):
    with pytest.raises(ValidationError, match="sigmaa"):
        kind(sigmaa=1.0)
    assert all(field.description for field in kind.model_fields.values())


@pytest.mark.parametrize(
    "kind, settings, part",
    [
        ("sonar_ring", {"sigma": -1.0}, "sigma"),
        ("sonar_ring", {"layout": "circle"}, "layout"),
        ("sonar_ring", {"range_min": 5.0}, "expected less than range_max = 4 m"),
        ("laser_2d", {"rate_hz": 7.0}, "rate_hz = 7, expected the tick rate, 20"),
        ("pitched_laser", {"sweep_time": 0.01}, "sweep_time = 0.01 s, expected at least one tick"),
        ("lidar", {}, "kind = 'lidar', expected one of pitched_laser, laser_2d, sonar_ring"),
    ],
)
def test_bad_settings_are_refused_with_the_sensors_name(bench, kind, settings, part):
    with pytest.raises(InputError, match="sensor eye") as error:
        bench(sensors=(("eye", kind, settings),))
    assert part in str(error.value)


def test_dropped_and_stuck_beams(bench):
    """In a room with a wall all round, 30 % of the beams are dropped."""
    walls = (Box("ahead", (2.0, 2.2), (-3.0, 3.0)), Box("left", (-3.0, 3.0), (2.0, 2.2)))
    laser = ("laser", "laser_2d", {"dropout": 0.3, "stuck_beam": 90, "stuck_range": 0.7})
    rows = [bench(sensors=(laser,), obstacles=walls, seed=seed).step().scans["laser"].ranges for seed in range(40)]
    whole = bench(sensors=(("laser", "laser_2d", {}),), obstacles=walls).step().scans["laser"].ranges
    seen = np.isfinite(whole)
    lost = np.mean([np.isinf(row[seen]).mean() for row in rows])
    assert 0.25 < lost < 0.35
    assert all(row[90] == 0.7 for row in rows)


def test_a_stuck_beam_must_exist():
    with pytest.raises(ValidationError, match="expected one of 0 to 180"):
        LaserSettings(stuck_beam=181)


def test_scans_that_are_stamped_late_arrive_late_and_see_what_punctual_ones_saw(bench):
    punctual = bench(sensors=(("laser", "laser_2d", {}),), obstacles=CLUTTER)
    late = bench(sensors=(("laser", "laser_2d", {"stamp_delay": 0.12}),), obstacles=CLUTTER)
    seen = [(punctual.step(0.3, 0.2).scans["laser"], late.step(0.3, 0.2).scans.get("laser")) for _ in range(6)]
    # Ticks of 50 ms: the scan of tick 0 arrives at 120 ms, in the third tick, and so on.
    assert [at for at, (_, scan) in enumerate(seen) if scan is None] == [0, 1]
    assert [scan.stamp_ns for _, scan in seen[2:]] == [120_000_000, 170_000_000, 220_000_000, 270_000_000]
    assert np.array_equal(seen[5][1].ranges, seen[2][0].ranges)
