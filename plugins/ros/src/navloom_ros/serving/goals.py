"""Forwards ROS goals to the robot: NavigateToPose, NavigateThroughPoses and RViz's /goal_pose. The newest one wins."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from navloom_ros.actions import ActionServer, Goal
from navloom_ros.frames import heading_of
from navloom_ros.node import Node
from navloom_ros.times import time_of
from navloom_ros.wire import epoch_ns, monotonic_ns

__all__ = ["Goals", "Place", "Robot", "place_of"]

TO_POSE, THROUGH_POSES = "nav2_msgs/action/NavigateToPose", "nav2_msgs/action/NavigateThroughPoses"
FEEDBACK_CHECK_INTERVAL = 0.1
"""Interval of checks whether the goal was cancelled or replaced, s."""
PASSED = 0.7
"""Distance within which a pose counts as passed, m; that of RemovePassedGoals in Nav2's own behaviour tree."""
UNKNOWN_ERROR = {TO_POSE: 9000, THROUGH_POSES: 9100}
"""Nav2's error codes for an unspecified failure, by action."""
PREEMPTED = "pre-empted by a newer goal"
"""Why a replaced goal was aborted."""


class Place(NamedTuple):
    """A goal: x, y, m, map frame; heading, rad, or None for any."""

    x: float
    y: float
    heading: float | None


class Robot(Protocol):
    """The method of `navloom.Navigator` that is used here."""

    def go(self, x: float, y: float, heading: float | None = None, via: Any = ()) -> Any: ...


class Wanted(NamedTuple):
    """A received goal: its places in order, its action goal, None if from /goal_pose, and the action's type."""

    places: list[Place]
    goal: Goal | None
    kind: str


class Goals:
    """Offers the action servers, and sends one goal at a time to the robot, on a thread.

    Args:
        node: Node that offers the actions.
        frame: Frame that goals must be given in.
        failures: Exceptions of `Robot.go` and of its handle that abort a goal.
        say: Shows a line to the user: why a goal was refused, or not reached. A repeated refusal is shown once.

    Attributes:
        robot: The robot; None while it is down, when goals are rejected.
        pose: Latest pose of the robot, x, y, m, heading, rad, for feedback; None before the first.
    """

    def __init__(
        self, node: Node, frame: str, failures: tuple[type[Exception], ...], say: Callable[[str], None]
    ) -> None:
        self.robot: Robot | None = None
        self.pose: tuple[float, float, float] | None = None
        self._node, self._frame, self._failures, self._say = node, frame, failures, say
        self._refusal = ""
        self._news = threading.Condition()
        self._newest: Wanted | None = None
        self._is_closing = False
        for name, kind in (("navigate_to_pose", TO_POSE), ("navigate_through_poses", THROUGH_POSES)):
            ActionServer(node, name, kind, self._starter(kind), lambda request: self._accept(_poses_of(request)))
        self._worker = threading.Thread(target=self._work, name="ros goals", daemon=True)
        self._worker.start()
        self._clicks = node.subscription("/goal_pose", "geometry_msgs/msg/PoseStamped")
        threading.Thread(target=self._take_clicks, name="ros goal_pose", daemon=True).start()

    def close(self) -> None:
        """Cancel the current goal and end the thread."""
        with self._news:
            self._is_closing = True
            self._news.notify_all()
        self._worker.join(5.0)

    def _take_clicks(self) -> None:
        while (received := self._clicks.take(None)) is not None:
            if self._accept([received.message]):
                self._put(Wanted([place_of(received.message.pose)], None, TO_POSE))

    def _starter(self, kind: str) -> Callable[[Goal], None]:
        return lambda goal: self._put(Wanted([place_of(pose.pose) for pose in _poses_of(goal.request)], goal, kind))

    def _put(self, wanted: Wanted) -> None:
        with self._news:
            older, self._newest = self._newest, wanted
            self._news.notify_all()
        if older is not None:
            self._end(older, PREEMPTED)

    def _accept(self, poses: list[Any]) -> bool:
        why = self._problem(poses)
        if why and why != self._refusal:
            self._say(f"goal refused: {why}")
        self._refusal = why
        return not why

    def _problem(self, poses: list[Any]) -> str:
        """Why the robot cannot be sent to these poses; empty if it can."""
        if self.robot is None:
            return "the robot is down, or has no pose yet"
        if not poses:
            return "it has no pose"
        for pose in poses:
            frame, (x, y, _) = pose.header.frame_id, place_of(pose.pose)
            if frame.lstrip("/") not in ("", self._frame):
                return f"it is in the frame {frame!r}: expected {self._frame!r}"
            if not (math.isfinite(x) and math.isfinite(y)):
                return f"its place {x:g}, {y:g} m is not finite"
        return ""

    def _work(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._newest is not None or self._is_closing)
                wanted, self._newest = self._newest, None
                if self._is_closing:
                    break
            if wanted is not None:
                self._drive(wanted)
        if wanted is not None:
            self._end(wanted, "the server ends")

    def _drive(self, wanted: Wanted) -> None:
        robot, (*via, last) = self.robot, wanted.places
        if robot is None:
            self._end(wanted, "the robot is down")
            return
        try:
            handle = robot.go(last.x, last.y, last.heading, [(one.x, one.y) for one in via])
            if wanted.goal is not None:
                wanted.goal.execute()
            self._follow(wanted, handle)
        except self._failures as error:
            self._say(f"goal {last.x:g}, {last.y:g} m not reached: {error}")
            self._end(wanted, str(error))

    def _follow(self, wanted: Wanted, handle: Any) -> None:
        """Publish feedback until the robot ends the goal or a newer goal replaces it; pass on a cancel request."""
        began_ns, asked, left = monotonic_ns(), False, list(wanted.places)
        while handle.result is None:
            try:
                for feedback in handle.updates(FEEDBACK_CHECK_INTERVAL):
                    self._pass(left)
                    self._tell(wanted, feedback, monotonic_ns() - began_ns, len(left))
            except TimeoutError:
                pass
            with self._news:
                is_over, is_closing = self._newest is not None, self._is_closing
            if (is_closing or (wanted.goal is not None and wanted.goal.is_canceling)) and not asked:
                handle.cancel()
                asked = True
            if is_over:  # the robot replaces the older goal by itself
                self._end(wanted, PREEMPTED)
                return
        result = handle.result
        why = "" if result.outcome == "succeeded" else f"{result.outcome}: {result.reason}"
        if result.outcome not in ("succeeded", "cancelled"):
            last = wanted.places[-1]
            self._say(f"goal {last.x:g}, {last.y:g} m not reached: {why}")
        self._end(wanted, why, result.outcome)

    def _pass(self, left: list[Place]) -> None:
        """Remove the poses that the robot has passed; the last one stays, as in Nav2."""
        while self.pose is not None and len(left) > 1 and math.dist(self.pose[:2], left[0][:2]) <= PASSED:
            del left[0]

    def _tell(self, wanted: Wanted, feedback: Any, spent_ns: int, left: int) -> None:
        if wanted.goal is None or self.pose is None:
            return
        x, y, heading = self.pose
        pose = {"position": {"x": x, "y": y}, "orientation": {"z": math.sin(heading / 2), "w": math.cos(heading / 2)}}
        values: dict[str, Any] = {
            "current_pose": {"header": {"frame_id": self._frame, "stamp": time_of(epoch_ns())}, "pose": pose},
            "navigation_time": time_of(spent_ns),
            "estimated_time_remaining": time_of(round(max(0.0, feedback.time_left) * 1e9)),
            "number_of_recoveries": min(feedback.recoveries, 32767),
            "distance_remaining": feedback.distance,
        }
        if wanted.kind == THROUGH_POSES:
            values["number_of_poses_remaining"] = left
        wanted.goal.feedback(**values)

    def _end(self, wanted: Wanted, why: str, outcome: str = "") -> None:
        goal = wanted.goal
        if goal is None:
            return
        fields = {name for name, _ in self._node.types.fields(f"{wanted.kind}_Result")}
        failed = {"error_code": UNKNOWN_ERROR[wanted.kind], "error_msg": why}
        if not why:
            goal.succeed()
        elif outcome == "cancelled" and goal.is_canceling:
            goal.canceled()
        else:
            goal.abort(**{name: value for name, value in failed.items() if name in fields})


def place_of(pose: Any) -> Place:
    """The place of a ROS pose; without a heading if its quaternion is invalid."""
    return Place(float(pose.position.x), float(pose.position.y), heading_of(pose.orientation))


def _poses_of(request: Any) -> list[Any]:
    """Poses of a goal of either action; Kilted and later wrap them in a nav_msgs/msg/Goals."""
    if hasattr(request, "pose"):
        return [request.pose]
    return list(getattr(request.poses, "goals", request.poses))
