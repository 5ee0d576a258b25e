"""Observes a live robot from outside: its streams and its status."""

from __future__ import annotations

import contextlib
import difflib
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from navloom.engine.streams import FRAMEWORK_PORTS
from navloom.errors import NavloomError
from navloom.messages import Envelope, Feedback, GateStatus, GoalResult, Message, Parameters
from navloom.messages.codec import CodecError, decode
from navloom.messages.generic import GenericMessage
from navloom.navigation.stop_reasons import NO_ROOM, OBSTACLE, WAITING
from navloom.plugins.opening import OPENER

from navloom_live.live.mailbox import Inlet, Mailbox, Packet
from navloom_live.operating.client import Client
from navloom_live.operating.nodes import Node, answering, missing
from navloom_live.transport.quality import is_retained, kind_of, most_of

__all__ = [
    "NO_GOAL",
    "NO_PATH",
    "WHERE_IT_IS",
    "NoStream",
    "changed_parameters",
    "envelope_fields",
    "last",
    "last_words",
    "message_fields",
    "progress",
    "resolve",
    "retained",
    "streams",
    "tap",
    "who_drives",
    "why_stopped",
]

FIRST = 4
"""Number of entries in the summary of an array."""
NO_GOAL = Feedback(0, "idle", 0.0, 0.0, 0.0, 0)
"""Feedback that stands for a goal node without any goal so far."""
NO_PATH = "no_trajectory"
"""Stop reason of a gate without a trajectory; not a fault if the robot has no goal."""
WHERE_IT_IS = (
    "`navloom place X Y HEADING` tells it where it is; if it sees little of the map, drive it with `navloom teleop` to "
    "where it sees more"
)
"""Remedy for a robot that does not know where it is."""
_STOPS = {
    "operator": ("by an operator", "`navloom resume` lets it drive again"),
    "contact": ("it touched something", "`navloom resume` when the way is clear"),
    "ending": ("its gate has ended", "`navloom up` restarts it"),
    "gone: goal main does not step": ("its goal node does not step", "`navloom doctor` looks for the cause"),
    "stale: goal main": ("its goal node does not step", "`navloom doctor` looks for the cause"),
    "silent: platform": ("the platform is silent", "`navloom doctor` looks for the cause"),
}
_WAITS = {
    "mapping": "it waits for a map",
    "planning": "it waits for a path",
    "driving": "its new path is not followed yet",
    "recovering": "it waits for its recovery",
    "waiting": "it waits for the platform",
    "searching": "it does not know where it is",
}
"""Why the robot is stopped, by the state of the goal."""
_KINDS = {
    "silent": ("is silent", "`navloom hz` shows its stream, `navloom doctor` looks for the cause"),
    "rivals": ("publish the same stream", "`navloom doctor` names both: end one of them"),
    "gone": ("is gone", "`navloom doctor` says which process it belongs to"),
    "stale": ("gives commands from old data", "its process or the network is too slow: `navloom doctor` says which"),
    "old_selection": ("does not know of the last swap", "it passes with its next step, else ask `navloom doctor`"),
}


class NoStream(NavloomError, ValueError):
    """The robot has no stream of this key; the text names the nearest one."""


# --- its status -----------------------------------------------------------------------------------------------------


def last(client: Client, role: str, instance: str, port: str, timeout: float = 1.0) -> Message | None:
    """The last message of a stream whose publisher retains it; None if there is none."""
    for answer in client.ask_again(client.keys.port(role, instance, port), timeout):
        if not answer.refusal:
            with contextlib.suppress(CodecError):
                return decode(answer.data, answer.label)[0]
    return None


def last_words(client: Client) -> dict[str, Message | None]:
    """The last messages of the goal and the gate."""
    wanted = (("goal", "feedback"), ("goal", "result"), ("gate", "status"), ("gate", "selection"))
    return {f"{role}/{port}": last(client, role, "main", port) for role, port in wanted}


def changed_parameters(client: Client) -> dict[str, list[str]]:
    """TOML assignments of the parameters changed since the start, by "role instance"."""
    found = {}
    for answer in client.bus.ask(client.keys.port("*", "*", "parameters"), timeout=1.0):
        with contextlib.suppress(CodecError):
            message = decode(answer.data, answer.label)[0] if not answer.refusal else None
            if isinstance(message, Parameters) and message.values:
                role, name, _ = client.keys.split(answer.key)
                found[f"{role} {name}"] = list(message.values)
    return dict(sorted(found.items()))


def progress(feedback: Feedback, pace: str = "") -> str:
    """State of a goal in words, with the remaining distance and time, localizer, pace, recoveries, cross-track error.

    Until the path is followed there is no remaining distance, so the state is shown as planning.
    """
    has_way = bool(feedback.distance or feedback.cross_track)
    parts: list[str] = ["planning" if feedback.state == "driving" and not has_way else feedback.state]
    if has_way:
        parts.append(f"{feedback.distance:.2f} m and {feedback.time_left:.0f} s left")
    if feedback.localizer:
        parts.append(f"localizer {feedback.localizer}")
    if pace:
        parts.append(pace)
    if feedback.recoveries:
        parts.append(f"recoveries {feedback.recoveries}")
    if has_way:
        parts.append(f"cross-track {feedback.cross_track:+.2f} m")
    return ", ".join(parts)


def who_drives(status: GateStatus, feedback: Feedback | None = None, result: GoalResult | None = None) -> str:
    """The source that drives the robot, or why it is stopped, in a few words; see `why_stopped`."""
    if status.stopped:
        return f"stopped: {why_stopped(status, feedback, result)[0]}"
    if status.source == "none":
        return f"brakes: {why_stopped(replace(status, stopped=True), feedback, result)[0]}"
    who = "an operator drives" if status.source == "operator" else f"{status.source} {status.instance} drives"
    if status.limit == "overridden":
        return f"{who}, also into space that no sensor has seen"
    return f"{who}, slowed: {what_limits(status)}" if status.limit else who


def what_limits(status: GateStatus) -> str:
    """Why the gate's monitor slows or stops the robot, and where; empty if it does not."""
    what = {"obstacle": "obstacle", "unseen": "space that no sensor has seen"}.get(status.limit, "")
    if not what or status.place is None:
        return what
    bearing = math.degrees(math.atan2(status.place.y, status.place.x))
    side = f"{'left' if bearing > 0.0 else 'right'} ({abs(bearing):.0f}°)"
    if abs(bearing) < 15.0 or abs(bearing) > 165.0:
        side = "ahead" if abs(bearing) < 90.0 else "behind"
    if status.limit == "unseen" or status.distance is None:
        return f"{what} {side}"
    return f"{what} {status.distance:.2f} m away, {side}"


def why_stopped(
    status: GateStatus, feedback: Feedback | None = None, result: GoalResult | None = None
) -> tuple[str, str]:
    """Why the robot is stopped, in words that follow "stopped:", and what to do; both empty if it is not stopped.

    Args:
        status: Status of the gate.
        feedback: Last feedback of the goal; None if it is not known, `NO_GOAL` if there was none so far.
        result: Result of the last goal, if there was one.
    """
    if not status.stopped:
        return "", ""
    if status.reason == NO_PATH:
        return _without_path(feedback, result)
    if status.reason == OBSTACLE:
        return what_limits(status), "the goal recovers after 2 s; `navloom teleop` drives away from it"
    if status.reason == NO_ROOM:
        return f"{NO_ROOM}, {what_limits(status)}", "the recovery drives out and turns where there is room, after 2 s"
    if status.reason in _STOPS:
        return _STOPS[status.reason]
    kind, _, who = status.reason.partition(": ")
    if status.reason.startswith(WAITING):
        node, _, streams = who.partition(" for ")
        return waiting(node, streams)
    words, remedy = _KINDS.get(kind, ("", "`navloom echo gate/status` shows whether it passes"))
    who = "the operator" if who.startswith("operator") else who
    return (f"{who} {words}" if words else status.reason), remedy


def waiting(node: str, streams: str) -> tuple[str, str]:
    """Message that a node waits for the first message of streams, and what to do."""
    first = streams.split(" and ")[0].replace(".", "/")
    return (
        f"{node} waits for {streams}",
        f"`navloom hz {first}` shows whether it arrives, `navloom list` shows which nodes are missing",
    )


def _without_path(feedback: Feedback | None, result: GoalResult | None) -> tuple[str, str]:
    if feedback is None:
        return "no path to follow", "`navloom goal X Y` gives it a goal"
    if feedback.goal_id:
        return _WAITS.get(feedback.state, "no path to follow"), WHERE_IT_IS if feedback.state == "searching" else ""
    is_reached = result is not None and result.outcome == "succeeded"
    return ("goal reached" if is_reached else "no goal"), "`navloom goal X Y` gives it a goal"


# --- streams --------------------------------------------------------------------------------------------------------


def streams(nodes: Sequence[Node]) -> list[str]:
    """Every stream of the robot as role/instance/port."""
    return sorted(f"{node.role}/{node.instance}/{port}" for node in answering(nodes) for port in node.published)


def resolve(key: str, nodes: Sequence[Node]) -> list[str]:
    """Streams meant by role/instance/port, role/port or role, each with `*` for any.

    Raises:
        NoStream: None of that name.
    """
    known = streams(nodes)
    parts = key.strip("/").split("/")
    wanted = {1: [*parts, "*", "*"], 2: [parts[0], "*", parts[-1]]}.get(len(parts), parts)
    if len(wanted) == 3:
        fitting = [s for s in known if all(w in ("*", p) for w, p in zip(wanted, s.split("/"), strict=True))]
        if fitting:
            return fitting
    if not known:
        raise NoStream(f"no stream {key!r}: no node of the robot answers; `navloom doctor` says why")
    if lacking := _lacking(wanted, nodes):
        raise NoStream(f"no stream {key!r}: {', '.join(lacking)}; `navloom doctor` says why")
    raise NoStream(f"no stream {key!r}: expected role/port or role/instance/port; {_nearest(key, known)}")


def _lacking(wanted: Sequence[str], nodes: Sequence[Node]) -> list[str]:
    """Nodes of the wanted role and instance that are missing or do not answer."""
    found = [(gone.role, gone.instance, "is missing") for gone in missing(nodes)]
    found += [(node.role, node.instance, "does not answer") for node in nodes if node.description is None]
    return [f"{role} {name} {how}" for role, name, how in found if role == wanted[0] and wanted[1] in ("*", name)]


def _nearest(key: str, known: Sequence[str]) -> str:
    """Suggestion for a wrong key: the nearest stream, the streams of the role, or the roles."""
    short = list(dict.fromkeys(f"{role}/{port}" for role, _, port in (stream.split("/") for stream in known)))
    near = difflib.get_close_matches(key, [*known, *short], n=1, cutoff=0.8)  # the role's name makes up much of a key
    if near:
        return f"did you mean {near[0]!r}?"
    role = key.strip("/").split("/")[0]
    ports = [stream for stream in short if stream.startswith(f"{role}/")]
    return f"there are {', '.join(ports or dict.fromkeys(stream.split('/')[0] for stream in short))}"


def tap(client: Client, keys: Sequence[str], mailbox: Mailbox) -> dict[str, Inlet]:
    """Subscribe to streams, each given as role/instance/port."""
    taps: dict[str, Inlet] = {}
    for stream in keys:
        inlet = taps[stream] = Inlet(stream, mailbox, 4096)

        def receive(key: str, data: bytes | None, label: str, inlet: Inlet = inlet) -> None:
            if data is None:
                inlet.refuse("it is too large to be copied")
            else:
                inlet.give(Packet(data, label, opens=OPENER.open))

        role, _, port = stream.split("/", 2)
        client.bus.subscribe(f"{client.keys.prefix}/{stream}", receive, most_of(kind_of(role, port)))
    return taps


def retained(client: Client, stream: str) -> tuple[Message, Envelope] | None:
    """The last message of a stream whose publisher retains it, so that a viewer need not wait for the next one."""
    role, name, port = stream.split("/", 2)
    if is_retained(role, port) or not FRAMEWORK_PORTS.ports(role):
        for answer in client.bus.ask(client.keys.port(role, name, port), timeout=1.0):
            with contextlib.suppress(CodecError):
                if not answer.refusal:
                    return OPENER.open(answer.data, answer.label)
    return None


def message_fields(message: Message, whole: bool = False) -> dict[str, Any]:
    """A message as plain values; arrays as summaries, or whole."""
    if isinstance(message, GenericMessage):
        arrays = {f"array {number}": _plain(array, whole) for number, array in enumerate(message.arrays)}
        return {**{name: _plain(value, whole) for name, value in message.fields.items()}, **arrays}
    return {name: _plain(getattr(message, name), whole) for name in type(message).kinds}


def envelope_fields(envelope: Envelope) -> dict[str, Any]:
    """An envelope as plain values."""
    return envelope._asdict()


def _plain(value: Any, whole: bool) -> Any:
    if isinstance(value, Message):
        return message_fields(value, whole)
    if isinstance(value, dict):  # in a generic message
        return {name: _plain(entry, whole) for name, entry in value.items()}
    if isinstance(value, tuple):
        return [_plain(entry, whole) for entry in value]
    if isinstance(value, np.ndarray):
        return value.tolist() if whole else _summary(value)
    return value


def _summary(array: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Summary of an array; min, mean and max are over its finite entries, `infinite` counts the others."""
    finite = array[np.isfinite(array)]
    found: dict[str, Any] = {"dtype": array.dtype.name, "shape": list(array.shape)}
    if finite.size:
        found |= {"min": finite.min().item(), "mean": float(finite.mean()), "max": finite.max().item()}
    if finite.size < array.size:
        found["infinite"] = int(array.size - finite.size)
    return found | {"first": array.ravel()[:FIRST].tolist()}
