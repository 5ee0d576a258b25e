"""Nav2's planner and costmaps in front of the robot's planner and map: paths without driving, checks, clearing."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom_ros.actions import ActionServer, Goal
from navloom_ros.node import Node
from navloom_ros.services import Call
from navloom_ros.serving.error_codes import COMPUTE_PATH, error_code
from navloom_ros.serving.goals import NO_HEADING, Goals, place_of
from navloom_ros.times import time_of
from navloom_ros.wire import monotonic_ns

__all__ = ["Planning"]

COMPUTE = "nav2_msgs/action/ComputePathToPose"
CLEARED = ("global_costmap/clear_entirely_global_costmap", "local_costmap/clear_entirely_local_costmap")
"""Services that clear the map; navloom has one map for both of Nav2's."""
WAITING = 8
"""Most paths that wait to be planned; further goals are rejected."""


class Planning:
    """Offers the action `compute_path_to_pose` and the services `is_path_valid` and `clear_entirely_…_costmap`.

    Args:
        node: Node that offers them.
        goals: Has the robot, its pose and its map.
        frame: Frame that poses must be given in.
        failures: Exceptions of the robot that abort a goal.
        hits: Which of n places, (n, 3) m, m, rad, map frame, the robot cannot be at in a map, with its footprint: (n,);
            with True, neither where the map is unknown.
    """

    def __init__(
        self,
        node: Node,
        goals: Goals,
        frame: str,
        failures: tuple[type[Exception], ...],
        hits: Callable[[NDArray[np.float64], Any, NDArray[np.float64], bool], NDArray[np.bool_]],
    ) -> None:
        self._hits = hits
        self._types, self._now_ns = node.types, node.now_ns
        self._goals, self._frame, self._failures = goals, frame, failures
        self._waiting: queue.Queue[Goal] = queue.Queue(WAITING)
        ActionServer(node, "compute_path_to_pose", COMPUTE, self._waiting.put_nowait, self._accepts)
        node.service("is_path_valid", "nav2_msgs/srv/IsPathValid", self._judge)
        for name in CLEARED:
            node.service(name, "nav2_msgs/srv/ClearEntireCostmap", self._clear)
        threading.Thread(target=self._work, name="ros planning", daemon=True).start()

    def _accepts(self, request: Any) -> bool:
        frames = {request.goal.header.frame_id, request.start.header.frame_id if request.use_start else ""}
        is_here = {name.lstrip("/") for name in frames} <= {"", self._frame}
        return is_here and self._goals.robot is not None and not self._waiting.full()

    def _work(self) -> None:
        while True:
            goal = self._waiting.get()
            goal.execute()
            began_ns = monotonic_ns()
            try:
                points, kind, why = self._planned(goal.request)
            except self._failures as error:
                points, kind, why = [], "no_answer", str(error)
            spent = {"planning_time": time_of(monotonic_ns() - began_ns)}
            if goal.is_canceling:
                goal.canceled(**spent)
            elif points:
                goal.succeed(**spent, path=self._path(points))
            else:
                given = {"error_code": error_code(kind, COMPUTE_PATH), "error_msg": why, **spent}
                goal.abort(**self._types.known(f"{COMPUTE}_Result", given))

    def _planned(self, request: Any) -> tuple[list[tuple[float, float]], str, str]:
        robot, goal = self._goals.robot, place_of(request.goal.pose)
        start = place_of(request.start.pose) if request.use_start else self._goals.pose
        if robot is None or start is None:
            return [], "robot_down", "the robot is down, or has no pose yet"
        for name, place in (("start", start), ("goal", goal)):
            if place[2] is None:
                return [], "refused", f"the {name}: {NO_HEADING}"
        found: tuple[list[tuple[float, float]], str, str] = robot.plan(tuple(start), tuple(goal))
        return found

    def _path(self, points: list[tuple[float, float]]) -> dict[str, Any]:
        header = {"stamp": time_of(self._now_ns()), "frame_id": self._frame}
        turns = np.arctan2(*np.diff(points, axis=0).T[::-1]) if len(points) > 1 else np.zeros(1)
        poses = [
            {"header": header, "pose": {"position": {"x": x, "y": y}, "orientation": _rotation(float(turn))}}
            for (x, y), turn in zip(points, np.append(turns, turns[-1]), strict=False)
        ]
        return {"header": header, "poses": poses}

    def _judge(self, call: Call) -> None:
        """Whether the robot fits at each pose of a path in the map."""
        request, grid, footprint = call.request, self._goals.map, self._goals.footprint
        places = np.array([place_of(pose.pose) for pose in request.path.poses], np.float64).reshape(-1, 3)
        if grid is None or footprint is None:
            bad = np.ones(len(places), np.bool_)
        else:
            unknown_hits = getattr(request, "consider_unknown_as_obstacle", False)
            has_no_heading = np.isnan(places[:, 2])
            bad = has_no_heading | self._hits(footprint, grid, np.nan_to_num(places), unknown_hits)
        call.answer(
            is_valid=bool(len(bad)) and not bad.any(), invalid_pose_indices=np.flatnonzero(bad).astype(np.int32)
        )

    def _clear(self, call: Call) -> None:
        robot = self._goals.robot
        if robot is None:
            call.drop()
            return
        try:
            robot.clear_map()
        except self._failures:
            call.drop()
        else:
            call.answer()


def _rotation(heading: float) -> dict[str, float]:
    return {"z": float(np.sin(heading / 2)), "w": float(np.cos(heading / 2))}
