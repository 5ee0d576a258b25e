"""Late scans of the simulator, with the noise and slip of `building`, are measured; localisation is punctual again."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.plugin_factory import make_plugins
from navloom.messages import PoseEstimate, RangeScan, Truth, Twist2D
from navloom.roles import Platform, PlatformInput
from navloom.runs import run_episode
from navloom_calibration.laser_track import Beams, Way
from navloom_calibration.measured import measure
from navloom_calibration.offset import Interval

PERIOD = 0.05
START = "navigation.start={ x = -1.0, y = 1.0 }"


def measured(late: float, seed: int, seconds: float = 60.0) -> Interval:
    """The offset from a minute of turns of 0.5 to 1 rad/s and straight ways in the shipped room."""
    system = assemble(load_config("building", [f"sensor.laser.stamp_delay={late}", START], seed))
    make_plugins(system, only={("platform", "sensors_sim")})
    robot, rng = system.plugin("platform", "sensors_sim"), np.random.default_rng(seed)
    assert isinstance(robot, Platform)
    scans, rows, wanted, twist, until, touched, leg = list[Beams](), [], (0.0, 0.0), np.zeros(2), 0, False, 0
    for tick in range(round(seconds / PERIOD)):
        if tick >= until:
            leg += 1
            straight = (-0.3 if touched else 0.3, 0.0)
            wanted = straight if leg % 2 else (0.0, float(rng.choice([-1, 1])) * rng.uniform(0.5, 1.0))
            until, touched = tick + round((1.5 if leg % 2 else rng.uniform(1.0, 2.5)) / PERIOD), False
        twist += np.clip(np.array(wanted) - twist, [-0.5 * PERIOD, -3.0 * PERIOD], [0.5 * PERIOD, 3.0 * PERIOD])
        told = PlatformInput(Twist2D(twist[0], 0.0, twist[1]), None, round(tick * PERIOD * 1e9))
        given = robot.advance(told)
        touched |= given.contact.touching
        pose = given.odometry.pose
        rows.append((given.odometry.stamp_ns * 1e-9, pose.x, pose.y, pose.heading))
        for scan in given.scans.values():
            assert isinstance(scan, RangeScan)
            scans.append(Beams(scan.stamp_ns * 1e-9, scan.origins, scan.bearings, scan.half_angles, scan.time_offsets,
                               scan.ranges, scan.range_min, scan.range_max))  # fmt: skip
    table = np.array(rows)
    table[:, 3] = np.unwrap(table[:, 3])
    found = measure(scans, Way(table[:, 0], table[:, 1:]), np.zeros(2))
    assert found.offset is not None, found.why_no_offset
    return found.offset.offset


@pytest.mark.slow
def test_late_scans_are_measured_within_10_ms_and_the_interval_covers_the_truth() -> None:
    covered = 0
    for number, late in enumerate((0.0, 0.02, 0.05, 0.12, 0.3)):
        found = [measured(late, 10 * number + seed) for seed in range(1, 11)]
        errors = np.array([one.value + late for one in found])
        covers = sum(one.low <= -late <= one.high for one in found)
        covered += covers
        half = 1e3 * np.mean([one.half for one in found])
        print(f"late by {late:.2f} s: error {1e3 * errors.mean():+.1f} ± {1e3 * errors.std():.1f} ms, "
              f"largest {1e3 * np.abs(errors).max():.1f}; interval ± {half:.1f} ms covers {covers} of 10")  # fmt: skip
        assert np.abs(errors).max() < 0.01
    assert covered >= 45


class Errors:
    """Errors of the pose in ticks in which the robot turns fast."""

    wants = frozenset({("localizer", "pose"), ("platform", "truth")})
    wants_steps = False

    def __init__(self) -> None:
        self.truth: Truth | None = None
        self.found: list[tuple[float, float]] = []

    def on_message(self, role, instance, active, port, message, at) -> None:  # type: ignore[no-untyped-def]
        if isinstance(message, Truth):
            self.truth = message
        elif isinstance(message, PoseEstimate) and self.truth is not None and abs(self.truth.twist.wz) > 0.6:
            true, pose = self.truth.pose, message.pose
            turn = math.degrees(abs(math.remainder(pose.heading - true.heading, math.tau)))
            self.found.append((math.hypot(pose.x - true.x, pose.y - true.y), turn))

    def on_step(self, record: object) -> None: ...


def worst_of(late: float, offset: float, seed: int) -> np.ndarray:
    """RMS error while turning at up to 1 rad/s, m and degrees."""
    changes = [
        f"sensor.laser.stamp_delay={late}",
        f"sensor.laser.time_offset={offset}",
        "navigation.path_shape='as_planned'",
    ]
    errors = Errors()
    run_episode(load_config("building", changes, seed), observers=[errors])
    assert len(errors.found) > 10
    return np.sqrt((np.array(errors.found) ** 2).mean(axis=0))


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.05, 0.12, 0.3])
def test_with_the_measured_offset_the_pose_is_that_of_punctual_scans_within_2_cm_and_1_degree(late: float) -> None:
    offset = measured(late, 1).value
    more = np.mean([worst_of(late, offset, seed) - worst_of(0.0, 0.0, seed) for seed in (1, 2, 3)], axis=0)
    without = np.mean([worst_of(late, 0.0, seed) - worst_of(0.0, 0.0, seed) for seed in (1, 2, 3)], axis=0)
    print(f"late by {late:.2f} s: {1e3 * more[0]:+.1f} mm, {more[1]:+.2f}° with the offset; "
          f"{1e3 * without[0]:+.1f} mm, {without[1]:+.2f}° without")  # fmt: skip
    assert more[0] < 0.02 and more[1] < 1.0
