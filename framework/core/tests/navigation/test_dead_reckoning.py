"""The default localizer, with a pose that an operator sets."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
from navloom.messages import Odometry, Pose2D, Twist2D
from navloom.navigation.dead_reckoning import OdometryLocalizer
from navloom.roles import LocalizerInput, Params


def test_it_continues_from_the_pose_that_an_operator_sets() -> None:
    context: Any = SimpleNamespace(start=Pose2D(1.0, 0.0, 0.0), robot=None, period=0.05)
    localizer = OdometryLocalizer(Params(), context)

    def at(x: float, y: float, heading: float) -> tuple[float, float, float]:
        odometry = Odometry(0, Pose2D(x, y, heading), Twist2D(0.0, 0.0, 0.0))
        pose = localizer.localize(LocalizerInput(odometry, (), None)).pose
        return pose.x, pose.y, pose.heading

    assert at(2.0, 1.0, math.pi / 2) == (3.0, 1.0, math.pi / 2)
    localizer.place(Pose2D(10.0, 5.0, 0.0))
    assert at(2.0, 1.0, math.pi / 2) == pytest.approx((10.0, 5.0, 0.0))
    assert at(2.0, 2.0, math.pi / 2) == pytest.approx((11.0, 5.0, 0.0))  # 1 m ahead
