"""Data that Foxglove gets of a robot: topics, frames, and the contents of each kind of message."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from navloom.messages import (
    Command,
    GateStatus,
    MapUpdate,
    OccupancyGrid,
    Odometry,
    Path,
    Pose2D,
    PoseEstimate,
    RangeScan,
    StopReason,
    Trajectory,
    Twist2D,
)
from navloom_viewer.drawing import Shown
from navloom_viewer.foxglove import FoxgloveServer
from navloom_viewer.viewer_errors import ViewerError

foxglove = pytest.importorskip("foxglove")
STILL = Twist2D(0.0, 0.0, 0.0)


class Kept(FoxgloveServer):
    """Keeps the messages that it would serve."""

    def __init__(self) -> None:
        super().__init__("lab/r1", "127.0.0.1", 0)
        self.logged: list[tuple[str, str, dict[str, Any]]] = []
        self.placed: dict[str, tuple[float, float, float]] = {}

    def _log(self, topic: str, kind: str, at: int, **values: Any) -> None:
        super()._log(topic, kind, at, **values)
        self.logged.append((topic, kind, values))

    def _transform(self, parent: str, child: str, pose: Pose2D, at: int) -> None:
        super()._transform(parent, child, pose, at)
        self.placed[child] = (pose.x, pose.y, pose.heading)


def shown(role: str, port: str, message: Any, active: bool = True) -> Shown:
    return Shown("r1", role, "main", active, port, message, 3, 1_500_000_000)


def test_each_message_has_its_topic_and_frame() -> None:
    server = Kept()
    assert server.address.startswith("ws://127.0.0.1:")
    cells = np.array([[0, 100], [-1, 50]], dtype=np.int8)
    ranges = np.array([1.0, math.inf])
    scan = RangeScan(0, np.zeros((2, 2)), np.array([math.pi / 2, 0.0]), np.zeros(2), np.zeros(2), ranges, 0.1, 9.0)
    samples = np.zeros((500, 6))
    grid = OccupancyGrid(cells, 0.1, Pose2D(-1.0, 0.0, 0.0))
    for role, port, message in (
        ("platform", "odometry", Odometry(0, Pose2D(1.0, 0.0, 0.0), STILL)),
        ("localizer", "pose", PoseEstimate(0, Pose2D(2.0, 3.0, math.pi / 2), STILL, np.zeros((3, 3)))),
        ("platform", "laser", scan),
        ("mapper", "map", MapUpdate(0, grid, np.zeros((0, 4)), ())),
        ("planner", "path", Path(1, np.zeros((2, 2)), 0.0, None)),
        ("reference", "trajectory", Trajectory(1, samples)),
        ("gate", "command", Command(Twist2D(0.2, 0.0, 0.1))),
        ("gate", "status", GateStatus("none", "", True, False, StopReason("operator"), ())),
    ):
        server.put(shown(role, port, message))
    server.put(shown("planner", "path", Path(1, np.ones((2, 2)), 0.0, None), active=False))
    server.close()
    kinds = [(topic, kind) for topic, kind, _ in server.logged]
    assert kinds == [
        ("/tf/base_link", "FrameTransform"), ("/pose", "PoseInFrame"), ("/tf/odom", "FrameTransform"),
        ("/laser", "PointCloud"), ("/map", "Grid"), ("/plan", "PosesInFrame"), ("/trajectory", "PosesInFrame"),
        ("/gate", "Log"),
    ]  # fmt: skip
    values = {topic: given for topic, _, given in server.logged}
    # The base is at (2, 3) in the map, turned left, and at (1, 0) in odom: so odom is at (2, 2).
    assert server.placed["odom"] == (pytest.approx(2.0), pytest.approx(2.0), pytest.approx(math.pi / 2))
    points = np.frombuffer(values["/laser"]["data"], "<f4").reshape(-1, 3)
    assert points.tolist() == [pytest.approx([0.0, 1.0, 0.0], abs=1e-6)]
    pixels = np.frombuffer(values["/map"]["data"], np.uint8).reshape(2, 2, 4)
    assert pixels[0, 0].tolist() == [255, 255, 255, 255] and pixels[0, 1].tolist() == [0, 0, 0, 255]
    assert pixels[1, 0, 3] == 0 and values["/map"]["column_count"] == 2
    assert len(values["/trajectory"]["poses"]) <= 200 and values["/gate"]["message"] == "stopped: operator"


def test_a_port_in_use_gives_one_error() -> None:
    server = FoxgloveServer("a", "127.0.0.1", 0)
    port = int(server.address.rpartition(":")[2])
    with pytest.raises(ViewerError, match=f"--foxglove 127.0.0.1:{port}: cannot be listened at"):
        FoxgloveServer("b", "127.0.0.1", port)
    server.close()
