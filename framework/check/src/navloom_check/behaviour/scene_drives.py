"""Drives of a simple robot through scenes: its pose is known exactly, and its acceleration is limited."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from navloom.geometry.footprints import circumscribed_radius
from navloom.messages import Pose2D, PoseEstimate, Twist2D
from navloom.roles import RobotSpec
from numpy.typing import NDArray

from navloom_check.behaviour.measurements import PERIOD, PERIOD_NS, Line, robot_of
from navloom_check.behaviour.obstacle_scene import Scene

__all__ = ["FinishedDrive", "Pose", "drive", "estimate_at", "towards"]

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
STILL = (1e-3, 1e-3)
"""Speed, m/s, and turn rate, rad/s, below which a robot is stopped."""
LONG = 80
"""Ticks of being stopped after which a drive is over."""
NO_COVARIANCE = np.zeros((3, 3))


@dataclass(frozen=True, eq=False)
class FinishedDrive:
    """A drive that is over.

    Attributes:
        poses: (n, 3) x, y, m, heading, rad, map frame, one a tick.
        twists: (n, 2) speed, m/s, and turn rate, rad/s.
        gap: Least distance of the footprint from any obstacle, m: exact in contact, else of the poses that were
            measured, and at most twice the true one.
        ended: Why it ended: the reason that the step gave, "stopped" or "contact"; empty if the time was up.
    """

    poses: Floats
    twists: Floats
    gap: float
    ended: str

    @property
    def line(self) -> Line:
        """The track, to draw."""
        return Line("driven", self.poses, is_robot=True)


def drive(
    scene: Scene,
    seconds: float,
    step: Callable[[int, Pose, tuple[float, float]], tuple[float, float] | str],
    *,
    may_stand: bool = False,
) -> FinishedDrive:
    """Drive from the scene's start.

    Args:
        scene: Obstacles, and the robot's start.
        seconds: Longest time, s.
        step: Called with run clock, ns, pose, and (speed, turn rate). Returns the commanded (speed, turn rate), or the
            reason to end the drive.
        may_stand: The robot may be stopped for any time; otherwise 4 s of standstill end the drive.
    """
    robot = robot_of(scene)
    x, y, heading, v, w = scene.start.x, scene.start.y, scene.start.heading, 0.0, 0.0
    poses, twists, ended, still = [(x, y, heading)], [(v, w)], "", 0
    # The least distance so far, and the least that it can be now.
    gap = room = scene.gap(x, y, heading)
    reach = circumscribed_radius(scene.outline)
    for tick in range(round(seconds / PERIOD)):
        asked = step(tick * PERIOD_NS, (x, y, heading), (v, w))
        if isinstance(asked, str):
            ended = asked
            break
        v, w = _limited(asked, v, robot)
        x, y = (
            x + v * math.cos(heading + 0.5 * w * PERIOD) * PERIOD,
            y + v * math.sin(heading + 0.5 * w * PERIOD) * PERIOD,
        )
        heading = math.remainder(heading + w * PERIOD, math.tau)
        poses.append((x, y, heading))
        twists.append((v, w))
        # No point of the footprint has come nearer than by this way; measuring takes longer than the step itself.
        room -= (abs(v) + reach * abs(w)) * PERIOD
        if room <= 0.5 * gap:
            room = scene.gap(x, y, heading)
            gap = min(gap, room)
        still = still + 1 if abs(v) < STILL[0] and abs(w) < STILL[1] else 0
        if still > LONG and not may_stand:
            ended = "stopped"
            break
        if gap <= 0.0:
            ended = "contact"
            break
    return FinishedDrive(np.array(poses), np.array(twists), gap, ended)


def _limited(asked: tuple[float, float], v: float, robot: RobotSpec) -> tuple[float, float]:
    """The command within the robot's limits, as the gate limits it."""
    speed = min(max(asked[0], -robot.max_linear), robot.max_linear)
    gain = (robot.max_acceleration if abs(speed) > abs(v) else robot.max_deceleration) * PERIOD
    speed = min(max(speed, v - gain), v + gain)
    return speed, min(max(asked[1], -robot.max_angular), robot.max_angular)


def estimate_at(stamp_ns: int, pose: Pose, twist: tuple[float, float]) -> PoseEstimate:
    """The estimate of a perfect localizer."""
    return PoseEstimate(stamp_ns, Pose2D(*pose), Twist2D(twist[0], 0.0, twist[1]), NO_COVARIANCE)


def towards(pose: Pose, target: tuple[float, float], fastest: float = 0.4) -> tuple[float, float]:
    """Speed, m/s, and turn rate, rad/s, of a controller that heads straight for a target."""
    bearing = math.remainder(math.atan2(target[1] - pose[1], target[0] - pose[0]) - pose[2], math.tau)
    away = math.hypot(target[0] - pose[0], target[1] - pose[1])
    return min(fastest, away) * max(0.0, math.cos(bearing)), min(max(1.5 * bearing, -1.0), 1.0)
