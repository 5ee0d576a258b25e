"""Where a robot is, how fast, and how sure, as `navloom status` says it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from described import BusInWords, client, everyone
from navloom.messages import Pose2D, PoseEstimate, Twist2D
from navloom_live.cli.status import rows
from navloom_live.operating.introspection import last_words
from navloom_live.operating.pose_report import pose_fields
from navloom_live.operating.robot_nodes import listing


def status_rows(at: PoseEstimate) -> dict[str, str]:
    asked = client(BusInWords(everyone()))
    return dict(rows("lab/r1", listing(asked), last_words(asked), {}, (), at))


def test_status_says_where_the_robot_is_how_fast_and_how_sure() -> None:
    covariance = np.diag([0.01, 0.04, math.radians(1.5) ** 2])
    at = PoseEstimate(0, Pose2D(1.0, -2.0, math.pi / 2), Twist2D(0.3, 0.4, 0.1), covariance)
    assert status_rows(at)["pose"] == "(1.00, -2.00), 90°, 0.50 m/s, ± 0.20 m, ± 1.5°"
    found = pose_fields(at)
    assert (found["position_std"], found["heading_std_deg"]) == (pytest.approx(0.2), pytest.approx(1.5))
    assert (found["speed"], found["turn_rate_deg"]) == (pytest.approx(0.5), pytest.approx(5.7296, abs=1e-4))


def test_the_uncertainty_of_a_place_is_that_along_its_longer_axis() -> None:
    covariance = np.array([[0.05, 0.04, 0.0], [0.04, 0.05, 0.0], [0.0, 0.0, 0.0]])  # 0.09 along the diagonal
    at = PoseEstimate(0, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0), covariance)
    assert pose_fields(at)["position_std"] == pytest.approx(0.3)


def test_the_uncertainty_of_a_localizer_that_cannot_tell_is_not_known() -> None:
    at = PoseEstimate(0, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
    assert status_rows(at)["pose"] == "(0.00, 0.00), 0°, 0.00 m/s, uncertainty not known"
    assert pose_fields(at)["position_std"] is None


def test_status_of_a_robot_without_a_goal_says_that_its_localizer_is_not_tracking() -> None:
    at = PoseEstimate(0, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)), "searching", "few echoes fit")
    found = status_rows(at)
    assert found["localizer"].startswith("searching: few echoes fit; `navloom place X Y HEADING` tells it where it is")
    tracking = PoseEstimate(0, at.pose, at.twist, at.covariance)
    assert status_rows(tracking)["localizer"] == "tracking"
