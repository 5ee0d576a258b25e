"""Drives a live robot from Python: goals with feedback and results, stops, swaps and parameters."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple

from navloom.messages import Feedback, GateStatus, GoalResult, Odometry, Point2D

from navloom_live.live.mailbox import Inlet, Mailbox, Packet
from navloom_live.live.requests import CANCEL, SUBMIT, Submit
from navloom_live.live.service import Nothing
from navloom_live.operating import operator_actions
from navloom_live.operating.client import Client, ClientError, Refused
from navloom_live.operating.introspection import last, streams
from navloom_live.operating.robot_lookup import join
from navloom_live.operating.robot_nodes import listing
from navloom_live.operating.stream_subscription import Listening
from navloom_live.operating.teleoperation import Driver
from navloom_live.timing import ROBOT_GONE_AFTER
from navloom_live.transport.quality_of_service import kind_of, most_of

if TYPE_CHECKING:
    import numpy as np
    from navloom.config import Loaded
    from numpy.typing import NDArray

    from navloom_live.operating.diagnosis import Diagnosis

__all__ = ["GoalHandle", "Navigator"]

RESULT_QUERY_INTERVAL = 1.0
"""Interval of queries for the robot's last result, s, in case it came while the link was down."""
GOAL_LOST_AFTER = 3.0
"""Time after which a restarted goal node that has not mentioned a goal counts as having lost it, s."""


class GoalStreams(NamedTuple):
    """Inlets of the streams that report on goals."""

    results: Inlet
    feedbacks: Inlet
    gate: Inlet
    odometry: Inlet


def rejection(refusal: Refused, x: float, y: float) -> GoalResult:
    """The result of a goal that was refused immediately."""
    place = Point2D(x, y) if math.isfinite(x) and math.isfinite(y) else Point2D(0.0, 0.0)
    return GoalResult(0, "rejected", str(refusal).removeprefix("rejected: "), place, "refused")


class GoalHandle:
    """A goal that was sent to a robot.

    Attributes:
        goal_id: Its number.
        feedback: Newest feedback, or None.
        result: Its result, or None before its end.
        gate: Newest status of the gate: who drives, or why the robot is stopped.
        speed: Newest measured forward speed, m/s, or None.
    """

    def __init__(self, client: Client, mailbox: Mailbox, streams: GoalStreams, goal_id: int) -> None:
        self.goal_id = goal_id
        self.feedback: Feedback | None = None
        self.result: GoalResult | None = None
        self.gate: GateStatus | None = None
        self.speed: float | None = None
        self._client, self._mailbox, self._streams = client, mailbox, streams
        self._asked = self._seen = self._known = time.monotonic()
        self._lives = client.lives("goal", "main")
        self._note(last(client, "gate", "main", "status"))

    def updates(self, timeout: float | None = None) -> Iterator[Feedback]:
        """Yield feedback as it arrives, until the goal has ended. It continues while nodes of the robot restart.

        Raises:
            TimeoutError: The goal has not ended within `timeout`, s; ClientError: the robot is gone.
        """
        began = time.monotonic()
        seen = 0
        while self.result is None:
            seen = self._mailbox.wait(seen, 0.1)
            streams = self._streams
            for message, _ in (*streams.results.take(), *streams.gate.take(), *streams.odometry.take()):
                self._note(message)
            for message, _ in self._streams.feedbacks.take():
                if isinstance(message, Feedback) and message.goal_id == self.goal_id:
                    self.feedback = message
                    yield message
            now = time.monotonic()
            if self.result is None and now - self._asked > RESULT_QUERY_INTERVAL:
                self._asked = now
                self._note(last(self._client, "goal", "main", "result"))
                if self.result is None:
                    self._refuse_endless_wait()
            if timeout is not None and self.result is None and now - began > timeout:
                raise TimeoutError(f"goal {self.goal_id} has not ended within {timeout:g} s")

    def wait(self, timeout: float | None = None, on_feedback: Callable[[Feedback], None] | None = None) -> GoalResult:
        """Wait for the result.

        Args:
            timeout: Longest wait, s; None for no limit.
            on_feedback: Called with each feedback.

        Raises:
            TimeoutError: The result did not come in time; ClientError: the robot is gone.
        """
        for feedback in self.updates(timeout):
            if on_feedback is not None:
                on_feedback(feedback)
        assert self.result is not None
        return self.result

    def cancel(self) -> None:
        """Cancel it."""
        self._client.call("goal", "main", CANCEL, Nothing())

    def _refuse_endless_wait(self) -> None:
        client, now = self._client, time.monotonic()
        lives = client.lives("goal", "main")
        if lives or client.has_nodes():
            self._seen = now
        elif client.was_ended:
            raise ClientError(f"robot {client.keys.prefix} went down, and goal {self.goal_id} with it")
        elif now - self._seen > ROBOT_GONE_AFTER:
            raise ClientError(
                f"robot {client.keys.prefix}: none of its nodes has been there for {ROBOT_GONE_AFTER:g} s, so the "
                f"outcome of goal {self.goal_id} is unknown; `navloom doctor` says what is missing"
            )
        self._lives = self._lives or lives
        if not lives or lives & self._lives:
            self._known = now
        elif now - self._known > GOAL_LOST_AFTER:
            raise ClientError(
                f"robot {client.keys.prefix}: its goal node restarted and does not know goal {self.goal_id}, "
                "which ended with the previous node"
            )

    def _note(self, message: object) -> None:
        if isinstance(message, GateStatus):
            self.gate = message
        elif isinstance(message, Odometry):
            self.speed = message.twist.vx
        elif isinstance(message, GoalResult):
            if message.goal_id == self.goal_id:
                self.result = message
            elif message.goal_id > self.goal_id:
                why = f"goal {message.goal_id} came after it, and its own result was missed"
                self.result = GoalResult(self.goal_id, "cancelled", why, message.place, "preempted")


class Navigator:
    """A live robot, to be used in a `with` statement.

    Args:
        robot: REALM/NAME, or NAME if that is unique; None for the only one that is up on this host.
        connect: Endpoint of a router on another host.
        keys: Folder of certificates, see `navloom keys`.
        insecure: Allow plain TCP to another host.
        identity: Certificate of a folder `keys`: "operator", "viewer", or "operator or viewer", the first there is.

    Raises:
        DirectoryError: There is no such robot; LinkError, BusError: its network cannot be joined.
    """

    def __init__(
        self,
        robot: str | None = None,
        connect: str | None = None,
        keys: str | Path | None = None,
        insecure: bool = False,
        identity: str = "operator",
    ) -> None:
        self._stack = ExitStack()
        self._given = (robot, connect, str(keys) if keys is not None else None, identity, insecure)
        self._mailbox = Mailbox()
        self._client: Client | None = None

    @property
    def client(self) -> Client:
        """Client of the robot. Raises RuntimeError outside a `with` statement."""
        if self._client is None:
            raise RuntimeError("a Navigator joins its robot in a `with` statement: `with Navigator() as robot:`")
        return self._client

    def __enter__(self) -> Navigator:
        self._client = self._stack.enter_context(join(*self._given))
        self._streams = GoalStreams(
            self._inlet("goal", "main", "result"),
            self._inlet("goal", "main", "feedback"),
            self._inlet("gate", "main", "status"),
            self._inlet("platform", "*", "odometry", limit=1),
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def go(
        self, x: float, y: float, heading: float | None = None, via: Sequence[tuple[float, float]] = ()
    ) -> GoalHandle:
        """Send the robot to a place. This pre-empts the current goal.

        Args:
            x, y: Place, m, map frame.
            heading: Heading there, rad, map frame; None for any.
            via: Points to pass on the way, m, map frame.

        Raises:
            Refused: The goal is rejected immediately, with the reason; ClientError: the goal node does not answer.
        """
        for name, value in (("x", x), ("y", y), ("heading", 0.0 if heading is None else heading)):
            if not math.isfinite(value):
                raise Refused(f"rejected: {name} is {value}, expected a finite number")
        answer = self.client.call("goal", "main", SUBMIT, Submit(x, y, heading, tuple(via)))
        return GoalHandle(self.client, self._mailbox, self._streams, answer.goal_id)

    def drive_to(self, x: float, y: float, heading: float | None = None, timeout: float | None = None) -> GoalResult:
        """Send the robot to a place and wait for the result; a rejected goal is a result too.

        Args:
            x, y: Place, m, map frame.
            heading: Heading there, rad, map frame; None for any.
            timeout: Longest wait, s; None for no limit.
        """
        try:
            handle = self.go(x, y, heading)
        except Refused as refusal:
            return rejection(refusal, x, y)
        return handle.wait(timeout)

    def cancel(self) -> bool:
        """Cancel the current goal; False if there is none."""
        return operator_actions.cancel(self.client)

    def stop(self) -> None:
        """Stop the robot until `resume`."""
        self.client.stop()

    def resume(self) -> None:
        """Let the robot drive again after a stop or a contact."""
        operator_actions.resume(self.client)

    def place(self, x: float, y: float, heading: float, sigma: tuple[float, float] | None = None) -> str:
        """Tell the robot where it is. A goal that it drives to is planned again from there.

        Every localizer takes the pose, so that a swap keeps it.

        Args:
            x, y: Place, m, map frame.
            heading: Heading, rad, map frame.
            sigma: Standard deviations of x and of y, m, and of the heading, rad, if it is a guess: the localizer then
                searches for the robot near there, and anywhere if it is not there. None for an exact pose.

        Returns:
            A warning if the robot does not fit there; empty otherwise.

        Raises:
            Refused: The place is outside the map, a number is not finite, or the active localizer accepts no pose;
                ClientError: there is no localizer, or it does not answer.
        """
        return operator_actions.place(self.client, x, y, heading, sigma)

    def relocalise(self) -> None:
        """Have the localizer forget where the robot is, and search for it on the whole map.

        A goal waits meanwhile; if the recovery looks around, it moves the robot so that the localizer sees more.

        Raises:
            Refused: The active localizer cannot search; ClientError: there is none, or it does not answer.
        """
        operator_actions.relocalise(self.client)

    def plan(
        self, start: tuple[float, float, float], goal: tuple[float, float, float]
    ) -> tuple[list[tuple[float, float]], str, str]:
        """Plan on the newest map of the active planner, without driving.

        Args:
            start, goal: x, y, m, and heading, rad, map frame.

        Returns:
            The points of the path, m; or none, then the kind of the failure, see `PlanFailure`, and its explanation.

        Raises:
            Refused: There is no map yet; ClientError: there is no planner, or it does not answer.
        """
        found = operator_actions.plan(self.client, start, goal)
        return list(found.points), found.kind, found.detail

    def driving(self) -> Driver:
        """Manual driving for a `with` statement: `send` its speeds, m/s and deg/s, which the gate limits.

        Raises:
            ClientError: On entry or from `send`: the platform is silent, or the robot is stopped until `resume`.
        """
        return Driver(self.client)

    def clear_map(self) -> None:
        """Clear what the mapper can observe again. A recording of a live robot does not contain this."""
        operator_actions.clear_map(self.client)

    def footprint(self) -> NDArray[np.float64]:
        """The robot's outline as its config gives it: (n, 2) corners, counter-clockwise, m, base frame.

        Raises:
            ClientError: No process of the robot answers, or its config cannot be read.
        """
        return operator_actions.footprint(self.client)

    def limit_speed(self, speed: float, is_percentage: bool = False) -> float:
        """Limit the speed of all that drives but an operator, until the gate's process ends; return the limit, m/s.

        Args:
            speed: m/s, or % of the speed that the robot is expected to drive at without a limit; 0 for no limit.
            is_percentage: Whether it is %. 100 % and more are no limit.

        Raises:
            Refused: It is negative or not finite.
        """
        return operator_actions.limit_speed(self.client, speed, is_percentage)

    def swap(
        self, role: str, instance: str, timeout: float = 10.0, say: Callable[[str], None] = lambda text: None
    ) -> int:
        """Make another instance active as soon as it is ready, and return the epoch of the selection.

        A method that is installed, but not part of the running robot, is started in shadow first.

        Args:
            role: Name of the role, as avoider.
            instance: Its name in the config; or a plugin or plugin@preset to start.
            timeout: Longest wait for it to publish once it runs, s.
            say: Receives what happens on the way: that an instance is starting.

        Raises:
            Refused: There is no such instance, and none can be started; TimeoutError: it was not ready within
                `timeout`, s.
        """
        return operator_actions.swap(self.client, role, instance, timeout, say)

    def listen(self, streams: Sequence[str], limit: int = 4096) -> Listening:
        """Subscribe to streams, each as role/port or role/instance/port; `take` of the result gives new messages.

        A viewer over TLS may use the second form only; `streams` lists them. `limit` messages of each may wait.
        """
        return Listening(self.client, streams, limit)

    def streams(self) -> list[str]:
        """Every stream of the nodes that answer, as role/instance/port."""
        return streams(listing(self.client))

    def config(self) -> Loaded:
        """The config that the robot runs. Raises ClientError if no process reports it."""
        from navloom_live.operating.live_recorder import ask_header

        return ask_header(self.client).loaded()

    def doctor(self) -> Diagnosis:
        """What is wrong with the robot, with remedies, as `navloom doctor` finds it."""
        from navloom_live.operating.diagnosis import diagnose_joined

        return diagnose_joined(self.client)

    def get_parameters(self, role: str, instance: str) -> dict[str, Any]:
        """Parameters of an instance, for example role avoider and instance vff."""
        return operator_actions.get_parameters(self.client, role, instance)

    def set_parameters(self, role: str, instance: str, assignments: Sequence[str]) -> dict[str, Any]:
        """Change parameters between two ticks, all or none.

        Args:
            role, instance: Names, for example avoider and vff.
            assignments: TOML assignments, as `reach = 2.0`.

        Raises:
            Refused: One of them is not valid.
        """
        return operator_actions.set_parameters(self.client, role, instance, assignments)

    def _inlet(self, role: str, instance: str, port: str, limit: int = 64) -> Inlet:
        key = self.client.keys.port(role, instance, port)
        inlet = Inlet(key, self._mailbox, limit)

        def receive(key: str, data: bytes | None, label: str) -> None:
            if data is not None:
                inlet.give(Packet(data, label))

        self.client.bus.subscribe(key, receive, most_of(kind_of(role, port)))
        return inlet
