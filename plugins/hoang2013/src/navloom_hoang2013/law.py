"""Settling of law (6) of Hoang et al. 2013 from beside a line, by its gain k3, compared with other laws."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from navloom.config import check_params
from navloom.engine import stream_source
from navloom.geometry.footprints import rectangle
from navloom.messages import Point2D, Pose2D, PoseEstimate, Reference, Trajectory, Twist2D
from navloom.plugins import Discovery
from navloom.roles import Context, Controller, ControllerInput, RobotSpec
from numpy.typing import NDArray

__all__ = ["BAND", "BESIDE", "LAWS", "SPEED", "Law", "Settling", "settle"]

Floats = NDArray[np.float64]
BESIDE, SPEED, BAND = 0.3, 0.3, 0.02
"""Initial distance right of the line, m; speed of the reference, m/s; position error that counts as settled, m."""
STEP, UNTIL = 0.01, 62.0
"""Period of the commands and simulated time, s."""
UNLIMITED = 1000.0
"""Largest speeds and accelerations of a robot that is in effect unlimited, SI units."""
AS_PRINTED = {"turn_in_place_above_deg": 180.0}


@dataclass(frozen=True)
class Law:
    """A controller with its parameters.

    Attributes:
        name: Name for people.
        plugin: Name of the controller plugin.
        params: Its parameters, as in a config.
        stated: Settling time found by our study beforehand, s; None: more than a minute.
    """

    name: str
    plugin: str
    params: Mapping[str, float]
    stated: float | None


LAWS = (
    *(
        Law(f"law (6), k₁ = 1, k₃ = {k3:g}", "lyapunov_tracker", {"k1": 1.0, "k3": k3, **AS_PRINTED}, stated)
        for k3, stated in ((0.3, 17.0), (0.6, 14.6), (1.0, 28.2), (2.0, 59.3), (5.0, None))
    ),
    Law("RAMSETE, b = 16, ζ = 0.7", "ramsete", {"b": 16.0, "zeta": 0.7}, 2.4),
    Law("Kanayama, 10, 64, 16", "kanayama", {"k_x": 10.0, "k_y": 64.0, "k_theta": 16.0}, 1.6),
    Law("Fierro & Lewis, 10, 5, 4", "fierro_lewis", {"k1": 10.0, "k2": 5.0, "k3": 4.0}, 5.5),
)
FREE = {"turn_in_place_above_deg": 180.0, "approach_deg": 90.0, "may_reverse": True}
"""Parameters with which the laws of `trackers` run as printed in their own papers."""


@dataclass(frozen=True, eq=False)
class Settling:
    """The error of one law over time.

    Attributes:
        law: The law.
        times: (n,) s.
        lateral: (n,) e2, m.
        settled: Last time at which hypot(e1, e2) was `BAND` or more, s; None if it still was at the end.
    """

    law: Law
    times: Floats
    lateral: Floats
    settled: float | None


def settle(law: Law, discovery: Discovery, until: float = UNTIL) -> Settling:
    """Simulate the plugin from 0.3 m beside a line. The reference moves with time, and the robot has no limits.

    Raises:
        PluginError: The plugin is not installed.
    """
    plugin = _made(law, discovery)
    pose, twist = (0.0, -BESIDE, 0.0), Twist2D(SPEED, 0.0, 0.0)
    errors = np.empty((round(until / STEP), 2))
    given = _inputs()
    for tick in range(len(errors)):
        command = plugin.control(given(tick, pose, twist))
        errors[tick] = command.e1, command.e2
        twist = command.twist
        pose = _moved(pose, twist.vx, twist.wz)
    times = STEP * np.arange(len(errors), dtype=np.float64)
    outside = np.flatnonzero(np.hypot(errors[:, 0], errors[:, 1]) >= BAND)
    last = int(outside[-1])
    return Settling(law, times, errors[:, 1], None if last == len(errors) - 1 else float(times[last]))


def _made(law: Law, discovery: Discovery) -> Controller:
    cls = discovery.role("controller", law.plugin)
    assert issubclass(cls, Controller)
    extra = {} if law.plugin == "lyapunov_tracker" else FREE
    params: Any = check_params(cls.Params, {**law.params, **extra}, "controller")
    robot = RobotSpec(rectangle(0.8, 0.8), 1.2, 0.05, 0.3, UNLIMITED, UNLIMITED, UNLIMITED, UNLIMITED)
    cls.warm_up()
    return cls(
        params, Context(law.plugin, STEP, robot, stream_source(0, "controller", law.plugin), Pose2D(0.0, 0.0, 0.0))
    )


def _inputs() -> Any:
    """A function that returns the input of a tick from tick, pose and twist. Constant parts are created once."""
    length = SPEED * UNTIL
    samples = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, SPEED], [length, length, 0.0, 0.0, 0.0, SPEED]])
    return partial(_input, Trajectory(1, samples), np.zeros((3, 3)))


def _input(
    trajectory: Trajectory, covariance: Floats, tick: int, pose: tuple[float, float, float], twist: Twist2D
) -> ControllerInput:
    stamp, x = round(tick * STEP * 1e9), SPEED * tick * STEP
    end = float(trajectory.samples[-1, 0])
    way = np.array([(x, 0.0), (x + 1.2, 0.0)])
    reference = Reference(1, x, end - x, Pose2D(x, 0.0, 0.0), SPEED, 0.0, pose[1], Point2D(x + 1.2, 0.0), way, 0.5)
    here = PoseEstimate(stamp, Pose2D(*pose), twist, covariance)
    return ControllerInput(stamp, trajectory, reference, here)


def _moved(pose: tuple[float, float, float], v: float, w: float) -> tuple[float, float, float]:
    """The unicycle after one step of constant velocity: an arc."""
    x, y, heading = pose
    half = 0.5 * w * STEP
    chord = v * STEP * (math.sin(half) / half if half else 1.0)
    turned = math.remainder(heading + w * STEP, math.tau)
    return (
        x + chord * math.cos(heading + half),
        y + chord * math.sin(heading + half),
        # A pose takes headings in [-π, π); math.remainder() gives π too.
        -math.pi if turned >= math.pi else turned,
    )
