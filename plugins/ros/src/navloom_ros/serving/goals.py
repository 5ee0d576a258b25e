"""Forwards ROS goals to the robot: Nav2's actions for poses and waypoints, and RViz's goal_pose; the newest wins."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np

from navloom_ros.actions import ActionServer, Goal
from navloom_ros.frames import heading_of
from navloom_ros.node import Node
from navloom_ros.serving.error_codes import NAVIGATE_THROUGH_POSES, NAVIGATE_TO_POSE, error_code
from navloom_ros.serving.map_cells import OCCUPIED, OUTSIDE, UNKNOWN, cells_at
from navloom_ros.times import time_of
from navloom_ros.wire import monotonic_ns

__all__ = ["NO_HEADING", "Goals", "Place", "Robot", "place_of"]

TO_POSE, THROUGH_POSES = "nav2_msgs/action/NavigateToPose", "nav2_msgs/action/NavigateThroughPoses"
FEEDBACK_CHECK_INTERVAL = 0.1
"""Interval of checks whether the goal was cancelled or replaced, s."""
PASSED = 0.7
"""Distance within which a pose counts as passed, m; that of RemovePassedGoals in Nav2's own behaviour tree."""
WAYPOINTS = "nav2_msgs/action/FollowWaypoints"
ACTIONS = {"navigate_to_pose": TO_POSE, "navigate_through_poses": THROUGH_POSES, "follow_waypoints": WAYPOINTS}
"""Types of the actions that are offered, by name."""
FAILED_WAYPOINT = 3
"""`waypoint_status` of a waypoint that was not reached (nav2_msgs/msg/WaypointStatus)."""
DETACHING = 5.0
"""Longest wait until a cancelled goal has ended, s; longer than a robot takes to brake and its goal node to answer."""
NO_HEADING = "its orientation is not a unit quaternion; for heading 0 give w = 1"
"""Why a pose is refused. No heading is made up: an orientation of zeros is often a forgotten one."""


class Place(NamedTuple):
    """A goal: x, y, m, map frame; heading, rad, or None for any."""

    x: float
    y: float
    heading: float | None


class Robot(Protocol):
    """The methods of `navloom.Navigator` that are used here, in `planning` and in `behaviours`."""

    def go(self, x: float, y: float, heading: float | None = None, via: Any = ()) -> Any: ...
    def plan(self, start: Any, goal: Any) -> Any: ...
    def clear_map(self) -> None: ...
    def driving(self) -> Any: ...


class Wanted(NamedTuple):
    """A received goal: its places in order, its action goal, None if from /goal_pose, and the action's type."""

    places: list[Place]
    goal: Goal | None
    kind: str


class Ended(NamedTuple):
    """How a goal, or the drive to one waypoint, ended: outcome, why it failed, empty if reached, and reason code."""

    outcome: str
    why: str
    code: str


PREEMPTED = Ended("cancelled", "pre-empted by a newer goal", "preempted")
"""End of a replaced goal."""


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
        map: Latest `navloom.messages.OccupancyGrid` of the robot; None before the first.
        footprint: (n, 2) corners of the robot's outline, m, base frame; None before it is known.
        is_stopped: The robot is stopped until `resume`, or its platform is silent.
    """

    def __init__(
        self, node: Node, frame: str, failures: tuple[type[Exception], ...], say: Callable[[str], None]
    ) -> None:
        self.robot: Robot | None = None
        self.pose: tuple[float, float, float] | None = None
        self.is_stopped = False
        self.map: Any = None
        self.footprint: Any = None
        self._node, self._frame, self._failures, self._say = node, frame, failures, say
        self._refusal = ""
        self._news = threading.Condition()
        self._newest: Wanted | None = None
        self._is_driving = self._is_held = self._is_leaving = self._is_closing = False
        for name, kind in ACTIONS.items():
            ActionServer(node, name, kind, self._starter(kind), lambda request: self._accept(_poses_of(request)))
        self._worker = threading.Thread(target=self._work, name="ros goals", daemon=True)
        self._worker.start()
        self._clicks = node.subscription("goal_pose", "geometry_msgs/msg/PoseStamped")
        threading.Thread(target=self._take_clicks, name="ros goal_pose", daemon=True).start()

    @property
    def can_drive(self) -> bool:
        """Whether a goal would be driven to now."""
        return self.robot is not None and not self.is_stopped

    @property
    def is_driving(self) -> bool:
        """Whether the robot drives to a goal, or will."""
        return self._is_driving or self._newest is not None

    def hold(self, is_held: bool) -> None:
        """Tell whether a behaviour drives the robot: `detach` waits for its end, which `robot` of None brings."""
        with self._news:
            self._is_held = is_held
            self._news.notify_all()

    def detach(self) -> None:
        """Cancel the goal that the robot drives to, and wait until it has ended; reject goals until `robot` is set.

        It needs the robot, so it is called before the connection to the robot closes.
        """
        with self._news:
            self.robot, self._is_leaving = None, True
            self._news.wait_for(lambda: not (self.is_driving or self._is_held), DETACHING)
            self._is_leaving = False

    def close(self) -> None:
        """End the thread, after `detach`."""
        with self._news:
            self._is_closing = True
            self._news.notify_all()
        self._worker.join(DETACHING)

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
            frame, (x, y, heading) = pose.header.frame_id, place_of(pose.pose)
            if frame.lstrip("/") not in ("", self._frame):
                return f"it is in the frame {frame!r}: expected {self._frame!r}"
            if not (math.isfinite(x) and math.isfinite(y)):
                return f"its place {x:g}, {y:g} m is not finite"
            if heading is None:
                return NO_HEADING
        return ""

    def _work(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._newest is not None or self._is_closing)
                wanted, self._newest = self._newest, None
                if wanted is None:  # closing
                    return
                self._is_driving = True
            self._drive(wanted)
            with self._news:
                self._is_driving = False
                self._news.notify_all()

    def _drive(self, wanted: Wanted) -> None:
        if wanted.kind == WAYPOINTS:
            self._visit(wanted)
        else:
            self._end(wanted, self._go(wanted, wanted.places))

    def _visit(self, wanted: Wanted) -> None:
        """Drive to one waypoint after the other; those that are not reached are missed, and the next one follows."""
        assert wanted.goal is not None
        request = wanted.goal.request
        missed: list[Any] = []
        rounds = [list(range(getattr(request, "goal_index", 0), len(wanted.places)))]
        rounds += [list(range(len(wanted.places)))] * getattr(request, "number_of_loops", 0)
        for index in (index for one in rounds for index in one):
            wanted.goal.feedback(current_waypoint=index)
            ended = self._go(wanted, [wanted.places[index]])
            if ended is PREEMPTED or self._is_leaving or wanted.goal.is_canceling:
                self._end(wanted, ended, missed)
                return
            if ended.why:
                missed.append(self._missed(index, request.poses[index], ended))
        self._end(wanted, Ended("succeeded", "", "reached"), missed)

    def _missed(self, index: int, pose: Any, ended: Ended) -> Any:
        """The entry of a waypoint that was not reached, of the type that the distribution has for it."""
        kind = self._node.types.element(f"{WAYPOINTS}_Result", "missed_waypoints")
        if not kind:  # an int32
            return index
        given = {"index": index, "goal": pose, "waypoint_index": index, "waypoint_pose": pose,
                 "waypoint_status": FAILED_WAYPOINT, "error_code": error_code(ended.code, NAVIGATE_TO_POSE),
                 "error_msg": ended.why}  # fmt: skip
        return {name: given[name] for name, _ in self._node.types.fields(kind)}

    def _go(self, wanted: Wanted, places: list[Place]) -> Ended:
        """Send the robot through places to the last one, and wait until that has ended."""
        robot, (*via, last) = self.robot, places
        if robot is None:
            return Ended("error", "the robot is down", "robot_down")
        try:
            handle = robot.go(last.x, last.y, last.heading, [(one.x, one.y) for one in via])
            if wanted.goal is not None:
                wanted.goal.execute()
            ended = self._follow(wanted, handle, places)
        except self._failures as error:
            ended = Ended("rejected", str(error), self._refusal_code(last))
        if ended.outcome not in ("succeeded", "cancelled"):
            self._say(f"goal {last.x:g}, {last.y:g} m not reached: {ended.why}")
        return ended

    def _refusal_code(self, place: Place) -> str:
        """Why the robot refused a goal, as far as its map shows it."""
        value = UNKNOWN if self.map is None else cells_at(self.map, np.array([place[:2]]))[0]
        return "outside_map" if value == OUTSIDE else "goal_occupied" if value >= OCCUPIED else "refused"

    def _follow(self, wanted: Wanted, handle: Any, places: list[Place]) -> Ended:
        """Publish feedback until the robot ends the goal or a newer goal replaces it; pass on a cancel request."""
        began_ns, asked, left = monotonic_ns(), False, list(places)
        while handle.result is None:
            try:
                for feedback in handle.updates(FEEDBACK_CHECK_INTERVAL):
                    self._pass(left)
                    self._tell(wanted, feedback, monotonic_ns() - began_ns, left)
            except TimeoutError:
                pass
            with self._news:
                is_over, is_leaving = self._newest is not None, self._is_leaving
            if (is_leaving or (wanted.goal is not None and wanted.goal.is_canceling)) and not asked:
                handle.cancel()
                asked = True
            if is_over:  # the robot replaces the older goal by itself
                return PREEMPTED
        result = handle.result
        why = "" if result.outcome == "succeeded" else f"{result.outcome}: {result.reason}"
        return Ended(result.outcome, why, result.code)

    def _pass(self, left: list[Place]) -> None:
        """Remove the poses that the robot has passed; the last one stays, as in Nav2."""
        while self.pose is not None and len(left) > 1 and math.dist(self.pose[:2], left[0][:2]) <= PASSED:
            del left[0]

    def _tell(self, wanted: Wanted, feedback: Any, spent_ns: int, left: list[Place]) -> None:
        if wanted.goal is None or wanted.kind == WAYPOINTS or self.pose is None:
            return
        x, y, heading = self.pose
        pose = {"position": {"x": x, "y": y}, "orientation": {"z": math.sin(heading / 2), "w": math.cos(heading / 2)}}
        # Without a path yet, a distance of 0 would read as "there": many scripts stop at it.
        straight = sum(math.dist(a[:2], b[:2]) for a, b in pairwise([self.pose, *left]))
        values: dict[str, Any] = {
            "current_pose": {"header": {"frame_id": self._frame, "stamp": time_of(self._node.now_ns())}, "pose": pose},
            "navigation_time": time_of(spent_ns),
            "estimated_time_remaining": time_of(round(max(0.0, feedback.time_left) * 1e9)),
            "number_of_recoveries": min(feedback.recoveries, 32767),
            "distance_remaining": feedback.distance or straight,
        }
        if wanted.kind == THROUGH_POSES:
            values["number_of_poses_remaining"] = len(left)
        wanted.goal.feedback(**values)

    def _end(self, wanted: Wanted, ended: Ended, missed: Sequence[Any] = ()) -> None:
        goal = wanted.goal
        if goal is None:
            return
        first = NAVIGATE_THROUGH_POSES if wanted.kind == THROUGH_POSES else NAVIGATE_TO_POSE
        values = {"error_code": error_code(ended.code, first), "error_msg": ended.why, "missed_waypoints": list(missed)}
        result = self._node.types.known(f"{wanted.kind}_Result", values)
        if not ended.why:
            goal.succeed(**result)
        elif ended.outcome == "cancelled" and goal.is_canceling:
            goal.canceled(**result)
        else:
            goal.abort(**result)


def place_of(pose: Any) -> Place:
    """The place of a ROS pose; without a heading if its quaternion is invalid."""
    return Place(float(pose.position.x), float(pose.position.y), heading_of(pose.orientation))


def _poses_of(request: Any) -> list[Any]:
    """Poses of a goal of either action; Kilted and later wrap them in a nav_msgs/msg/Goals."""
    if hasattr(request, "pose"):
        return [request.pose]
    return list(getattr(request.poses, "goals", request.poses))
