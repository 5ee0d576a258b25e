"""Action servers and clients: three services and two topics for each action (design.ros2.org, "Actions")."""

from __future__ import annotations

import threading
import uuid
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np

from navloom_ros.graph import ACTION_PART
from navloom_ros.node import Node
from navloom_ros.qos import LATCHED, Qos
from navloom_ros.services import Call
from navloom_ros.times import ns_of, time_of

__all__ = [
    "ABORTED",
    "ACCEPTED",
    "CANCELED",
    "CANCELING",
    "EXECUTING",
    "SUCCEEDED",
    "ActionClient",
    "ActionServer",
    "Goal",
    "SentGoal",
]

ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = range(1, 7)
"""States of a goal, numbered as in action_msgs/msg/GoalStatus."""
UNKNOWN = 0
"""State of a goal that the server does not know."""
ENDED = (SUCCEEDED, CANCELED, ABORTED)
"""States in which a goal has a result."""
MOST_RESULTS = 100
"""Most ended goals whose results a server keeps."""
MOST_OPEN = 100
"""Most goals of a server that have not ended; further ones are rejected."""
MOST_WAITING = 64
"""Most clients that may wait for the result of one goal."""
_CANCEL_NONE, _CANCEL_REJECTED, _CANCEL_UNKNOWN, _CANCEL_ENDED = range(4)
_FEEDBACK = Qos(depth=10)


class Goal:
    """A goal on the server's side, which executes and ends it. Its methods may be called from any thread.

    Attributes:
        identity: Its UUID, 16 bytes.
        request: The goal itself, a message of the type `…_Goal`.
        state: ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED or ABORTED.
        accepted_ns: When it was accepted, ns, on the clock of the node.
    """

    def __init__(self, server: ActionServer, identity: bytes, request: Any) -> None:
        self.identity = identity
        self.request = request
        self.state = ACCEPTED
        self.accepted_ns = server.now_ns()
        self._server = server
        self._waiting: list[Call] = []
        self._result: Any = None

    @property
    def is_canceling(self) -> bool:
        """A client has asked to cancel it, the server agreed, and it has not ended yet."""
        return self.state == CANCELING

    @property
    def has_ended(self) -> bool:
        """The goal has a result."""
        return self.state in ENDED

    def execute(self) -> None:
        """Set the state EXECUTING."""
        self._server.move(self, EXECUTING)

    def feedback(self, **values: Any) -> None:
        """Publish feedback, with values of the type `…_Feedback`."""
        self._server.send_feedback(self, values)

    def succeed(self, **values: Any) -> None:
        """End it as SUCCEEDED, with values of the type `…_Result`."""
        self._server.end(self, SUCCEEDED, values)

    def abort(self, **values: Any) -> None:
        """End it as ABORTED, with values of the type `…_Result`."""
        self._server.end(self, ABORTED, values)

    def canceled(self, **values: Any) -> None:
        """End it as CANCELED, with values of the type `…_Result`."""
        self._server.end(self, CANCELED, values)

    def result_for(self, call: Call) -> None:
        """Answer a request for the result, now or when the goal ends. The server calls it with its lock held."""
        if self.has_ended:
            call.answer(status=self.state, result=self._result)
        elif len(self._waiting) < MOST_WAITING:
            self._waiting.append(call)
        else:
            call.drop()

    def end_with(self, state: int, result: Any) -> list[Call]:
        """Store the result and return the requests that wait for it. The server calls it with its lock held."""
        self.state, self._result = state, result
        waiting, self._waiting = self._waiting, []
        return waiting


class ActionServer:
    """Offers an action.

    Args:
        node: Node that offers it.
        name: Its name, as `navigate_to_pose`.
        type_name: Its type, as `nav2_msgs/action/NavigateToPose`.
        start: Receives each accepted goal. It must not block: it hands the goal to a thread that executes it.
        accept: Whether to accept a goal, a message of the type `…_Goal`. It must not block.
        cancel: Whether a goal may be cancelled; if so, its `is_canceling` becomes true.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        type_name: str,
        start: Callable[[Goal], None],
        accept: Callable[[Any], bool] = lambda request: True,
        cancel: Callable[[Goal], bool] = lambda goal: True,
    ) -> None:
        self._types = node.types
        self.now_ns = node.now_ns
        self._type = type_name
        self._start, self._accept, self._cancel = start, accept, cancel
        self._goals: OrderedDict[bytes, Goal] = OrderedDict()
        self._lock = threading.RLock()
        part = f"{name}{ACTION_PART}"
        self._feedback = node.publisher(f"{part}feedback", f"{type_name}_FeedbackMessage", _FEEDBACK)
        self._status = node.publisher(f"{part}status", "action_msgs/msg/GoalStatusArray", LATCHED)
        node.service(f"{part}cancel_goal", "action_msgs/srv/CancelGoal", self._on_cancel)
        node.service(f"{part}get_result", f"{type_name}_GetResult", self._on_get_result)
        node.service(f"{part}send_goal", f"{type_name}_SendGoal", self._on_send_goal)

    def move(self, goal: Goal, state: int) -> None:
        """Change the state of a goal that has not ended."""
        with self._lock:
            # A request to cancel may come before the executing thread says that it begins.
            if not goal.has_ended and not (state == EXECUTING and goal.is_canceling):
                goal.state = state
                self._publish_status()

    def send_feedback(self, goal: Goal, values: dict[str, Any]) -> None:
        """Publish feedback of a goal that has not ended."""
        with self._lock:
            if not goal.has_ended:
                self._feedback.publish(goal_id=_identified(goal.identity), feedback=values)

    def end(self, goal: Goal, state: int, values: dict[str, Any]) -> None:
        """End a goal with a result; one that has already ended does not change."""
        result = self._types.new(f"{self._type}_Result", **values)
        with self._lock:
            if goal.has_ended:
                return
            waiting = goal.end_with(state, result)
            self._forget_old()
            self._publish_status()
        # Outside the lock: an answer goes over the network.
        for call in waiting:
            call.answer(status=state, result=result)

    def _on_send_goal(self, call: Call) -> None:
        identity = call.request.goal_id.uuid.tobytes()
        with self._lock:
            open_goals = sum(not one.has_ended for one in self._goals.values())
            has_room = identity not in self._goals and open_goals < MOST_OPEN
            accepted = has_room and self._accept(call.request.goal)
            goal = Goal(self, identity, call.request.goal)
            if accepted:
                self._goals[identity] = goal
            # Before the goal starts: clients take feedback of an unknown goal for somebody else's.
            call.answer(accepted=accepted, stamp=time_of(goal.accepted_ns))
            if not accepted:
                return
            self._publish_status()
        try:
            self._start(goal)
        except Exception:  # of foreign code; the service counts it, and the clients get a result
            goal.abort()
            raise

    def _on_get_result(self, call: Call) -> None:
        with self._lock:
            goal = self._goals.get(call.request.goal_id.uuid.tobytes())
            if goal is None:
                call.answer(status=UNKNOWN)
            else:
                goal.result_for(call)

    def _on_cancel(self, call: Call) -> None:
        """Cancel the goal with the given id, all goals accepted up to the given time, or both; with neither, all."""
        named = call.request.goal_info.goal_id.uuid.tobytes()
        until_ns = ns_of(call.request.goal_info.stamp)
        anonymous = not any(named)
        with self._lock:
            meant = [
                goal
                for goal in self._goals.values()
                if goal.identity == named or (anonymous and not until_ns) or 0 < goal.accepted_ns <= until_ns
            ]
            open_goals = [goal for goal in meant if not goal.has_ended]
            cancelled = [goal for goal in open_goals if goal.is_canceling or self._cancel(goal)]
            for goal in cancelled:
                goal.state = CANCELING
            code = _CANCEL_NONE
            if not cancelled:
                unknown = not anonymous and named not in self._goals
                ended = not anonymous and not open_goals
                code = _CANCEL_UNKNOWN if unknown else _CANCEL_ENDED if ended else _CANCEL_REJECTED
            self._publish_status()
            call.answer(return_code=code, goals_canceling=[_information(goal) for goal in cancelled])

    def _publish_status(self) -> None:
        statuses = [{"goal_info": _information(goal), "status": goal.state} for goal in self._goals.values()]
        self._status.publish(status_list=statuses)

    def _forget_old(self) -> None:
        ended = [identity for identity, goal in self._goals.items() if goal.has_ended]
        # Clients may ask for a result long after the end, but not for ever.
        for identity in ended[:-MOST_RESULTS]:
            del self._goals[identity]


class ActionClient:
    """Sends goals to an action server.

    Args:
        node: Node that uses the action.
        name: Its name, as `navigate_to_pose`.
        type_name: Its type, as `nav2_msgs/action/NavigateToPose`.

    Attributes:
        failed: Calls of `on_feedback` that raised.
        reason: What the last of them raised.
    """

    def __init__(self, node: Node, name: str, type_name: str) -> None:
        self.failed = 0
        self.reason = ""
        self._node = node
        self._type = type_name
        self._sent: dict[bytes, SentGoal] = {}
        part = f"{name}{ACTION_PART}"
        self._send = node.client(f"{part}send_goal", f"{type_name}_SendGoal")
        self.cancel_goal = node.client(f"{part}cancel_goal", "action_msgs/srv/CancelGoal")
        self.get_result = node.client(f"{part}get_result", f"{type_name}_GetResult")
        self._feedback = node.subscription(f"{part}feedback", f"{type_name}_FeedbackMessage", _FEEDBACK)
        threading.Thread(target=self._read_feedback, name=f"feedback {name}", daemon=True).start()

    def wait(self, timeout: float) -> bool:
        """Wait for a server, at most `timeout` s; whether there is one."""
        name = self._send.entity.name
        return bool(self._node.wait_for(lambda graph: graph.find(name, ("SS",)), timeout))

    def send(self, goal: Any, on_feedback: Callable[[Any], None] | None = None, timeout: float = 10.0) -> SentGoal:
        """Send a goal and wait until the server has accepted or rejected it.

        Args:
            goal: Of the type `…_Goal`, or its values by field.
            on_feedback: Receives each message of the type `…_Feedback`, on a thread of this client.
            timeout: Longest wait for the answer, s.

        Raises:
            NoAnswer: There is no server, or it took too long.
        """
        identity = uuid.uuid4().bytes
        sent = SentGoal(self, identity, on_feedback)
        # Before the request: feedback may overtake the answer.
        self._sent[identity] = sent
        try:
            response = self._send.call({"goal_id": _identified(identity), "goal": goal}, timeout)
        except BaseException:
            del self._sent[identity]
            raise
        sent.is_accepted = bool(response.accepted)
        if not sent.is_accepted:
            del self._sent[identity]
        return sent

    def forget(self, identity: bytes) -> None:
        """Stop delivering feedback of a goal."""
        self._sent.pop(identity, None)

    def _read_feedback(self) -> None:
        while (received := self._feedback.take(None)) is not None:
            sent = self._sent.get(received.message.goal_id.uuid.tobytes())
            if sent is not None and sent.on_feedback is not None:
                try:
                    sent.on_feedback(received.message.feedback)
                except Exception as error:  # of foreign code; other goals still get their feedback
                    self.failed += 1
                    self.reason = f"{type(error).__name__}: {error}"


class SentGoal:
    """A goal on the client's side.

    Attributes:
        identity: Its UUID, 16 bytes.
        is_accepted: The server has accepted it.
        on_feedback: Receives its feedback.
    """

    def __init__(self, client: ActionClient, identity: bytes, on_feedback: Callable[[Any], None] | None) -> None:
        self.identity = identity
        self.is_accepted = False
        self.on_feedback = on_feedback
        self._client = client

    def result(self, timeout: float) -> Future[Any]:
        """A future of the result: a message with `status` and `result`, or NoAnswer after `timeout` s."""
        future = self._client.get_result.ask({"goal_id": _identified(self.identity)}, timeout)
        future.add_done_callback(lambda _: self._client.forget(self.identity))
        return future

    def cancel(self, timeout: float = 10.0) -> bool:
        """Ask the server to cancel it; whether it agrees. Raises NoAnswer if the server does not answer in time."""
        response = self._client.cancel_goal.call({"goal_info": {"goal_id": _identified(self.identity)}}, timeout)
        return bool(response.return_code == _CANCEL_NONE and len(response.goals_canceling))


def _identified(identity: bytes) -> dict[str, Any]:
    return {"uuid": np.frombuffer(identity, np.uint8)}


def _information(goal: Goal) -> dict[str, Any]:
    return {"goal_id": _identified(goal.identity), "stamp": time_of(goal.accepted_ns)}
