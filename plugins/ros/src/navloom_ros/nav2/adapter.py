"""`Nav2Navigator`: a Python client for the actions of Nav2, with the feedback and the results of navloom."""

from __future__ import annotations

import math
import queue
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from navloom import Feedback, GoalResult, Point2D

from navloom_ros.actions import CANCELED, SUCCEEDED, ActionClient, SentGoal
from navloom_ros.message_types import Types
from navloom_ros.node import Node
from navloom_ros.services import NoAnswer
from navloom_ros.times import ns_of
from navloom_ros.wire import ROUTER, monotonic_ns

__all__ = ["Nav2Handle", "Nav2Navigator"]

TO_POSE, THROUGH_POSES = "nav2_msgs/action/NavigateToPose", "nav2_msgs/action/NavigateThroughPoses"
THERE = 5.0
"""Longest wait for the action server to be discovered, s."""
LONGEST = 86_400.0
"""Longest duration of a goal, s; after it the result is an error."""
STATUS_CHECK_INTERVAL = 0.1
"""Interval at which a waiting caller checks whether the goal has ended, s."""
WAITING = 64
"""Most feedback messages that are queued; the oldest is dropped."""


class Nav2Handle:
    """A goal that was sent, as `Nav2Navigator.go` returns it.

    Attributes:
        goal_id: Number of the goal, from 1.
        feedback: Newest feedback that was read; None before the first.
        result: Result; None until `updates` or `wait` has seen the goal end.
    """

    def __init__(self, goal_id: int, goal: Point2D) -> None:
        self.goal_id = goal_id
        self.feedback: Feedback | None = None
        self.result: GoalResult | None = None
        self._place = goal
        # Bounded, since a caller need not read its feedback.
        self._told: queue.Queue[Any] = queue.Queue(WAITING)
        self._sent: SentGoal | None = None
        self._ending: Future[Any] | None = None

    def begin(self, sent: SentGoal) -> None:
        """Store the server's answer; a rejected goal has its result at once."""
        self._sent = sent
        if sent.is_accepted:
            self._ending = sent.result(LONGEST)
        else:
            self.result = GoalResult(self.goal_id, "rejected", "by the robot", self._place, "refused")

    def hear(self, message: Any) -> None:
        """Queue a feedback message; called on the thread of the action client."""
        if self._told.full():
            with suppress(queue.Empty):  # the reader was faster
                self._told.get_nowait()
        self._told.put_nowait(message)

    def updates(self, timeout: float | None = None) -> Iterator[Feedback]:
        """Yield feedback as it arrives, until the goal ends.

        Args:
            timeout: Longest wait for the end of the goal, s; None for no limit. The goal is not cancelled.

        Raises:
            TimeoutError: The goal has not ended in time.
        """
        end_ns = math.inf if timeout is None else monotonic_ns() + 1e9 * timeout
        while self.result is None:
            left = (end_ns - monotonic_ns()) * 1e-9
            try:
                # In short waits: the end of the goal comes by another way and does not wake this one.
                message = self._told.get(timeout=min(STATUS_CHECK_INTERVAL, max(0.001, left)))
            except queue.Empty:
                pass
            else:
                self.feedback = self._read(message)
                yield self.feedback
            self._look()
            if monotonic_ns() >= end_ns and self.result is None:
                raise TimeoutError(f"goal {self.goal_id} has not ended within {timeout:g} s")

    def wait(self, timeout: float | None = None, on_feedback: Callable[[Feedback], None] | None = None) -> GoalResult:
        """Wait for the result; the timeout is that of `updates`. Raises TimeoutError."""
        for feedback in self.updates(timeout):
            if on_feedback is not None:
                on_feedback(feedback)
        assert self.result is not None
        return self.result

    def cancel(self) -> None:
        """Cancel the goal. Raises NoAnswer if the server does not answer."""
        if self._sent is not None and self.result is None:
            self._sent.cancel()

    def _look(self) -> None:
        if self._ending is None or not self._ending.done():
            return
        try:
            ended = self._ending.result()
        except NoAnswer as error:
            self.result = GoalResult(self.goal_id, "error", f"{error}: its outcome is unknown", self._place)
            return
        # Which of the two fields there is differs between distributions.
        why = getattr(ended.result, "error_msg", "") or f"error code {getattr(ended.result, 'error_code', 'not given')}"
        if ended.status == SUCCEEDED:
            self.result = GoalResult(self.goal_id, "succeeded", "the goal was reached", self._place, "reached")
        elif ended.status == CANCELED:
            self.result = GoalResult(self.goal_id, "cancelled", "as asked", self._place, "by_operator")
        else:
            self.result = GoalResult(self.goal_id, "error", f"aborted: {why}", self._place)

    def _read(self, message: Any) -> Feedback:
        place = message.current_pose.pose.position
        # A pose that is not known must not replace the last one that was.
        if math.isfinite(place.x) and math.isfinite(place.y):
            self._place = Point2D(place.x, place.y)
        left = message.estimated_time_remaining
        distance = float(message.distance_remaining)
        is_known = math.isfinite(distance)
        return Feedback(
            self.goal_id, "driving", distance if is_known else 0.0, 1e-9 * ns_of(left), 0.0,
            int(message.number_of_recoveries),
        )  # fmt: skip


class Nav2Navigator:
    """A robot that runs Nav2, with the methods of `navloom.Navigator`: `go`, `drive_to`, `cancel`. Use it with `with`.

    Args:
        router: Endpoint of the robot's Zenoh router.
        domain: ROS_DOMAIN_ID.
        namespace: Namespace of the robot's nodes, as /robot1.
        distribution: ROS 2 distribution of the robot.
        folders: Folders with your own message definitions.
        frame: Frame of the goals.

    Raises:
        NoRouter: No router answers at the endpoint.
    """

    def __init__(
        self,
        router: str = ROUTER,
        domain: int = 0,
        namespace: str = "/",
        distribution: str = "jazzy",
        folders: Sequence[Path] = (),
        frame: str = "map",
    ) -> None:
        types = Types(distribution, folders)
        self._node = Node("navloom_goals", router=router, domain=domain, namespace=namespace, types=types)
        self._frame = frame
        self._clients: dict[str, ActionClient] = {}
        self._number = 0
        self._handle: Nav2Handle | None = None

    def __enter__(self) -> Nav2Navigator:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._node.close()

    def go(
        self, x: float, y: float, heading: float | None = None, via: Sequence[tuple[float, float]] = ()
    ) -> Nav2Handle:
        """Send the robot to x, y, m, with a heading, rad, through some points, m.

        A goal of Nav2 always has a heading. Without one, it is the direction of the last leg, or 0 without `via`.

        Raises:
            NoAnswer: There is no action server, or it does not answer.
        """
        last = heading or 0.0
        if heading is None and via:
            last = math.atan2(y - via[-1][1], x - via[-1][0])
        poses = [self._pose(a, b, 0.0) for a, b in via] + [self._pose(x, y, last)]
        goal: dict[str, Any] = {"pose": poses[-1]}
        if via:
            goal = {"poses": {"header": poses[0]["header"], "goals": poses} if self._has_goals() else poses}
        self._number += 1
        handle = self._handle = Nav2Handle(self._number, Point2D(x, y))
        kind = THROUGH_POSES if via else TO_POSE
        handle.begin(self._client(kind).send(goal, handle.hear))
        return handle

    def drive_to(self, x: float, y: float, heading: float | None = None, timeout: float | None = None) -> GoalResult:
        """Send the robot to x, y, m, with a heading, rad, and wait for the result; a rejected goal has one too.

        Raises:
            NoAnswer: See `go`.
            TimeoutError: See `Nav2Handle.updates`.
        """
        return self.go(x, y, heading).wait(timeout)

    def cancel(self) -> bool:
        """Cancel the current goal of this object; False if it has none."""
        if self._handle is None or self._handle.result is not None:
            return False
        self._handle.cancel()
        return True

    def _client(self, kind: str) -> ActionClient:
        name = "navigate_to_pose" if kind == TO_POSE else "navigate_through_poses"
        client = self._clients.get(kind)
        if client is None:
            client = self._clients[kind] = ActionClient(self._node, name, kind)
        # Each time, not only for a new client: Nav2 may have gone since.
        if not client.wait(THERE):
            raise NoAnswer(f"no node offers the action {name}: is Nav2 running, and is the distribution right?")
        return client

    def _has_goals(self) -> bool:
        """Whether the poses are a nav_msgs/msg/Goals, as in Kilted and later."""
        return self._node.types.distribution in ("kilted", "lyrical")

    def _pose(self, x: float, y: float, heading: float) -> dict[str, Any]:
        turned = {"z": math.sin(heading / 2.0), "w": math.cos(heading / 2.0)}
        return {"header": {"frame_id": self._frame}, "pose": {"position": {"x": x, "y": y}, "orientation": turned}}
