"""What the page shows of one robot, from its messages: frames as they come, and the state that several of them make."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
from navloom import (
    Command,
    Feedback,
    GateStatus,
    GoalResult,
    Odometry,
    Path,
    PlanFailure,
    PoseEstimate,
    RangeScan,
    Selection,
    TrackingCommand,
    Trajectory,
    Twist2D,
)
from navloom.messages import Hypotheses, PoseTrack, Sweep, Tracks
from navloom_live import Told, progress, what_limits, who_drives, why_stopped

from navloom_dashboard import frames
from navloom_dashboard.outbox import Frame, text_frame

__all__ = ["AgeClock", "RobotView"]

SHADOWED = ("controller", "avoider", "recovery")
"""Roles whose commands are compared."""
EVENTS = 64
"""Number of events that a page gets when it is opened, and most that wait for one."""
TRACK = 2000
"""Most poses that are kept to place a sweep: more than a robot has during one."""
STATE_INTERVAL_NS = 80_000_000
"""Shortest time between two states, ns of the run clock."""
AGE_WINDOW = 5.0
"""Time within which the freshest message defines the age of all others, s: a simulation may be slower than time."""


class AgeClock:
    """Age of what a robot stamped, without a clock in common: the freshest message of the last seconds has age 0."""

    def __init__(self) -> None:
        self._lead, self._coming, self._began, self._newest_ns = math.inf, math.inf, -math.inf, -1

    def hear(self, stamp_ns: int, now: float) -> None:
        """Note the arrival of a message with a stamp, ns, at a time of this host's monotonic clock, s."""
        if stamp_ns < self._newest_ns - AGE_WINDOW * 1e9:  # the robot has restarted
            self._lead = self._coming = math.inf
            self._newest_ns = stamp_ns
        self._newest_ns = max(self._newest_ns, stamp_ns)
        lead = now - stamp_ns * 1e-9
        if now - self._began > AGE_WINDOW:
            self._lead, self._coming, self._began = self._coming, math.inf, now
        self._coming = min(self._coming, lead)
        self._lead = min(self._lead, lead)

    def age(self, stamp_ns: int | None, now: float) -> float | None:
        """Age, s, of what has this stamp; None without a stamp, or before the first message."""
        if stamp_ns is None or not math.isfinite(self._lead):
            return None
        return max(0.0, now - self._lead - stamp_ns * 1e-9)


class RobotView:
    """Turns messages of a robot into frames.

    Args:
        active: Active instance of each role at the start.
        height: Of the robot, m.
    """

    def __init__(self, active: dict[str, str], height: float) -> None:
        self.active, self._height = active, height
        self._track: deque[tuple[int, float, float, float]] = deque(maxlen=TRACK)
        self.pose: PoseEstimate | None = None
        self.odometry: Odometry | None = None
        self._gate: GateStatus | None = None
        self._feedback: Feedback | None = None
        self._result: GoalResult | None = None
        self._commands: dict[str, dict[str, Twist2D]] = {}
        self._compared_ns, self._granted = -1, Twist2D(0.0, 0.0, 0.0)
        self._stated_ns = -STATE_INTERVAL_NS
        self._events: deque[Frame] = deque(maxlen=EVENTS)
        self._count = 0
        self._said: dict[str, str] = {}
        self.loads: list[dict[str, Any]] = []

    @property
    def events(self) -> list[Frame]:
        """The last events, oldest first."""
        return list(self._events)

    def take(self, told: Iterable[Told]) -> Iterator[Frame]:
        """Frames of new messages."""
        for one in sorted(told, key=lambda one: one.stamp_ns):
            yield from self._frames(one)
        stamp_ns = 0 if self.odometry is None else self.odometry.stamp_ns
        if not 0 <= stamp_ns - self._stated_ns < STATE_INTERVAL_NS and self.odometry is not None:
            self._stated_ns = stamp_ns
            yield self._state(stamp_ns)

    def _frames(self, told: Told) -> Iterator[Frame]:
        message, role = told.message, told.role
        is_active = self.active.get(role, told.instance) == told.instance
        if role in SHADOWED and isinstance(message, (Command, TrackingCommand)):
            yield from self._command(told, message.twist)
        elif isinstance(message, RangeScan):
            yield frames.scan_frame(message, told.port)
        elif isinstance(message, Sweep):
            yield from self._sweep(message)
        elif isinstance(message, Tracks) and is_active:
            yield frames.tracks_frame(message, f"{role} {told.port}")
        elif isinstance(message, Hypotheses) and is_active:
            yield frames.hypotheses_frame(message)
        elif isinstance(message, PoseEstimate) and is_active:
            self.pose = message
            if self._track and message.stamp_ns <= self._track[-1][0]:  # the robot has restarted
                self._track.clear()
            self._track.append((message.stamp_ns, message.pose.x, message.pose.y, message.pose.heading))
            yield frames.pose_frame(message)
            if message.state != "tracking":
                yield from self._event_of("localizer", "warning", f"localizer {message.state}", message.reason,
                                          "drag “I am here”, or relocalise", told.stamp_ns)  # fmt: skip
            else:
                yield from self._ended("localizer", "localizer tracking", told.stamp_ns)
        elif isinstance(message, Path) and is_active:
            yield frames.path_frame(message, told.stamp_ns)
        elif isinstance(message, Trajectory):
            yield frames.trajectory_frame(message, told.stamp_ns)
        else:
            yield from self._word(told)

    def _sweep(self, sweep: Sweep) -> Iterator[Frame]:
        """A sweep, each of its echoes from where the robot was then; nothing before the first pose."""
        if self._track:
            stamps, *poses = zip(*self._track, strict=True)
            track = PoseTrack(np.array(stamps), np.column_stack(poses))
            frame = frames.sweep_frame(sweep, track, self._height)
            if frame is not None:
                yield frame

    def _word(self, told: Told) -> Iterator[Frame]:
        message = told.message
        if isinstance(message, Odometry):
            self.odometry = message
        elif isinstance(message, Command) and told.role == "gate":
            self._granted = message.twist
        elif isinstance(message, Feedback):
            self._feedback = message
        elif isinstance(message, GateStatus):
            self._gate = message
            why, remedy = why_stopped(replace(message, stopped=True), self._feedback, self._result)
            if message.why is not None and not message.why.stop.is_at_rest:
                yield from self._event_of(
                    "stop", "warning", str(message.why.kind), f"stopped: {why}", remedy, told.stamp_ns
                )
            else:
                yield from self._ended("stop", who_drives(message, self._feedback, self._result), told.stamp_ns)
        elif isinstance(message, GoalResult):
            self._result = message
            level = "note" if message.outcome in ("succeeded", "cancelled") else "problem"
            text = f"goal {message.goal_id} {message.outcome}: {message.reason}"
            yield from self._event_of("goal", level, message.code or message.outcome, text, "", told.stamp_ns)
        elif isinstance(message, PlanFailure):
            yield from self._event_of("plan", "problem", message.kind, message.detail, "choose another goal, or clear "
                                      "the map", told.stamp_ns)  # fmt: skip
        elif isinstance(message, Selection):
            before = self.active.get("localizer")
            self.active |= message.chosen
            if self.active.get("localizer") != before:
                yield text_frame("hypotheses", {"places": []}, told.stamp_ns)  # those known are of the one before
            text = "active: " + ", ".join(message.instances)
            yield from self._event_of("selection", "note", "selection", text, "", told.stamp_ns)

    def _command(self, told: Told, twist: Twist2D) -> Iterator[Frame]:
        """Commands of one tick, which have one stamp, sent when the first one of another tick comes."""
        if told.stamp_ns != self._compared_ns:
            if self._commands:
                rows = {role: frames.command_rows([
                    (name, self.active.get(role, name) == name, one.vx, one.wz) for name, one in sorted(found.items())
                ]) for role, found in self._commands.items()}  # fmt: skip
                gate = {"v": self._granted.vx, "w": self._granted.wz}
                yield text_frame("commands", {"roles": rows, "gate": gate}, self._compared_ns)
            self._compared_ns, self._commands = told.stamp_ns, {}
        self._commands.setdefault(told.role, {})[told.instance] = twist

    def _state(self, stamp_ns: int) -> Frame:
        gate, feedback, result = self._gate, self._feedback, self._result
        twist = self.odometry.twist if self.odometry is not None else Twist2D(0.0, 0.0, 0.0)
        why, remedy = ("", "") if gate is None else why_stopped(gate, feedback, result)
        goal = None
        if feedback is not None and feedback.goal_id:
            goal = {
                "id": feedback.goal_id, "state": feedback.state, "distance": feedback.distance,
                "time_left": feedback.time_left, "cross_track": feedback.cross_track, "code": feedback.code,
                "recoveries": feedback.recoveries, "text": progress(feedback),
            }  # fmt: skip
        fields = {
            "state": feedback.state if feedback is not None else "idle",
            "drives": None if gate is None else gate.source,
            "instance": "" if gate is None else gate.instance,
            "driver": "its gate has said nothing so far" if gate is None else who_drives(gate, feedback, result),
            "stopped": gate is not None and gate.stopped,
            "latched": gate is not None and gate.latched,
            "why": why, "remedy": remedy,
            "at_rest": gate is not None and gate.why is not None and gate.why.stop.is_at_rest,
            "goal": goal,
            "result": None if result is None else {"id": result.goal_id, "outcome": result.outcome,
                                                   "reason": result.reason, "code": result.code},
            "v": twist.vx, "vy": twist.vy, "w": twist.wz,
            "granted": {"v": self._granted.vx, "w": self._granted.wz},
            "limit": None if gate is None or not gate.limit else {
                "kind": gate.limit, "share": gate.share, "text": what_limits(gate), "distance": gate.distance,
                "place_in_base": None if gate.place is None else [gate.place.x, gate.place.y],
            },
            "pending": [] if gate is None else list(gate.pending),
            "loads": self.loads,
        }  # fmt: skip
        return text_frame("state", fields, stamp_ns)

    def _event_of(self, about: str, level: str, code: str, text: str, remedy: str, stamp_ns: int) -> Iterator[Frame]:
        """An event, unless the last one about this says the same."""
        if self._said.get(about) == text:
            return
        self._said[about] = text
        self._count += 1
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        fields = {
            "id": self._count, "time": now, "run_time": stamp_ns * 1e-9,
            "level": level, "code": code, "text": text, "remedy": remedy,
        }  # fmt: skip
        frame = text_frame("event", fields, stamp_ns, f"event {self._count % EVENTS}")
        self._events.append(frame)
        yield frame

    def _ended(self, about: str, text: str, stamp_ns: int) -> Iterator[Frame]:
        """The event that something which was told is over; nothing if nothing was."""
        if about in self._said:
            yield from self._event_of(about, "note", about, text, "", stamp_ns)
