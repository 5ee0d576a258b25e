"""Nav2's behaviours `spin`, `backup` and `drive_on_heading`, driven as an operator drives: the gate limits each."""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable
from typing import NamedTuple

from navloom_ros.actions import ActionServer, Goal
from navloom_ros.node import Node
from navloom_ros.serving.goals import Goals
from navloom_ros.times import ns_of, time_of
from navloom_ros.wire import monotonic_ns

__all__ = ["Behaviours"]

Pose = tuple[float, float, float]
PERIOD = 0.05
"""Interval of commands, s; shorter than the time after which the gate counts an operator as silent."""
ALLOWED = 10.0
"""Longest duration of a goal without a `time_allowance`, s; the default of Nav2's scripts."""
HELD = 2.0
"""Time without progress after which the gate counts as holding the robot, s; longer than it takes to speed up."""
LEAST = 0.01
"""Progress, m or rad, that counts."""
TURN_RATE = 0.6
"""Turn rate of a spin, rad/s; the gate limits it to the robot's."""
GAIN = 2.0
"""Speed for each metre or radian that is left, 1/s, so that the robot slows down before its end."""
SLOWEST = 0.05
"""Share of the speed that is kept until the end."""


class Behaviour(NamedTuple):
    """An action: its type, its feedback field, and the codes of its own failures."""

    kind: str
    feedback: str
    unknown: int
    timeout: int
    collision: int
    invalid: int


ACTIONS = {
    "spin": Behaviour("nav2_msgs/action/Spin", "angular_distance_traveled", 700, 701, 703, 700),
    "backup": Behaviour("nav2_msgs/action/BackUp", "distance_traveled", 710, 711, 714, 713),
    "drive_on_heading": Behaviour("nav2_msgs/action/DriveOnHeading", "distance_traveled", 720, 721, 723, 724),
}


class Behaviours:
    """Offers the actions, and drives one goal at a time, on a thread.

    Args:
        node: Node that offers them.
        goals: Has the robot and its pose. While it drives to a goal, behaviours are rejected.
        failures: Exceptions of the robot that abort a behaviour.
        wait: Waits for some seconds.
    """

    def __init__(
        self, node: Node, goals: Goals, failures: tuple[type[Exception], ...], wait: Callable[[float], object]
    ) -> None:
        self._types, self._goals, self._failures, self._wait = node.types, goals, failures, wait
        self._waiting: queue.Queue[tuple[Goal, Behaviour]] = queue.Queue(1)
        self._is_busy = False
        for name, one in ACTIONS.items():
            ActionServer(node, name, one.kind, self._starter(one), lambda request: self._accepts())
        threading.Thread(target=self._work, name="ros behaviours", daemon=True).start()

    def _starter(self, one: Behaviour) -> Callable[[Goal], None]:
        return lambda goal: self._waiting.put_nowait((goal, one))

    def _accepts(self) -> bool:
        is_free = not self._is_busy and self._waiting.empty() and not self._goals.is_driving
        return is_free and self._goals.can_drive

    def _work(self) -> None:
        while True:
            goal, one = self._waiting.get()
            self._is_busy = True
            self._goals.hold(True)
            goal.execute()
            began_ns = monotonic_ns()
            try:
                code, why = self._drive(goal, one)
            except self._failures as error:
                code, why = one.unknown, str(error)
            values = {"total_elapsed_time": time_of(monotonic_ns() - began_ns), "error_code": code, "error_msg": why}
            result = self._types.known(f"{one.kind}_Result", values)
            self._is_busy = False
            (goal.canceled if goal.is_canceling else goal.abort if why else goal.succeed)(**result)
            self._goals.hold(False)  # last: it lets the node close

    def _drive(self, goal: Goal, one: Behaviour) -> tuple[int, str]:
        """Drive until the distance is done; the error code and why it is not, 0 and empty if it is."""
        request, robot, pose = goal.request, self._goals.robot, self._goals.pose
        if robot is None or pose is None:
            return one.unknown, "the robot is down"
        is_spin = one is ACTIONS["spin"]
        if is_spin:
            wanted, speed = request.target_yaw, math.copysign(TURN_RATE, request.target_yaw)
        elif one is ACTIONS["backup"]:
            wanted, speed = -abs(request.target.x), -abs(request.speed)
        else:
            wanted, speed = request.target.x, request.speed
        if not math.isfinite(wanted) or not math.isfinite(speed) or wanted * speed < 0.0 or (wanted and not speed):
            return one.invalid, f"distance {wanted:g} at speed {speed:g}: expected finite ones of the same sign"
        allowed_ns = ns_of(request.time_allowance) or round(ALLOWED * 1e9)
        began_ns = moved_ns = monotonic_ns()
        done = best = 0.0
        with robot.driving() as driver:
            while abs(wanted) - done > LEAST:
                now_ns, newest = monotonic_ns(), self._goals.pose or pose
                if goal.is_canceling or self._goals.robot is None:
                    break
                if now_ns - began_ns > allowed_ns:
                    return one.timeout, f"{done:.2f} of {abs(wanted):.2f} after {allowed_ns * 1e-9:g} s"
                turned = math.remainder(newest[2] - pose[2], math.tau)
                done += math.copysign(1.0, wanted) * turned if is_spin else self._ahead(pose, newest, wanted)
                pose = newest
                if done > best + LEAST:
                    best, moved_ns = done, now_ns
                elif now_ns - moved_ns > HELD * 1e9:
                    return one.collision, f"the gate holds the robot: {driver.limit or 'it does not move'}"
                goal.feedback(**{one.feedback: max(0.0, done)})
                share = min(1.0, max(SLOWEST, GAIN * (abs(wanted) - done) / abs(speed)))
                driver.send(0.0 if is_spin else share * speed, math.degrees(share * speed) if is_spin else 0.0)
                self._wait(PERIOD)
            driver.send(0.0, 0.0)
        return (0, "") if abs(wanted) - done <= LEAST else (one.unknown, "cancelled")

    def _ahead(self, before: Pose, now: Pose, wanted: float) -> float:
        """Distance from one pose to another along the robot's heading, in the wanted direction, m."""
        along = (now[0] - before[0]) * math.cos(now[2]) + (now[1] - before[1]) * math.sin(now[2])
        return math.copysign(1.0, wanted) * along
