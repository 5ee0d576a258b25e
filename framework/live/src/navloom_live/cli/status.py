"""`navloom status`: what a robot is doing, and why it is stopped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from navloom.cli.options import AsJson, RobotOptions

if TYPE_CHECKING:
    from navloom.engine.shadow_state import ShadowState

    from navloom_live.operating.robot_nodes import Node

__all__ = ["rows", "status"]

MOST_PLACES = 3
"""Most places that the status lists of those where a searching robot may be."""


def status(
    *,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Print what a live robot is doing, or why it is stopped.

    Its goal, where it is, how fast and how sure, the node that drives, and what lets a stopped robot drive again.
    """
    from navloom.cli.output import print_json, print_table

    from navloom_live.operating.client import ClientError
    from navloom_live.operating.introspection import changed_parameters, last_words
    from navloom_live.operating.pose_report import hypotheses_now, pose_now
    from navloom_live.operating.robot_nodes import listing
    from navloom_live.operating.shadow_report import shadows_of

    with robot.look() as client:
        nodes, words, changed = listing(client), last_words(client), changed_parameters(client)
        shadows = shadows_of(client, nodes)
        pose = pose_now(client, nodes)
        places = hypotheses_now(client, nodes)
    if not nodes:
        raise ClientError(f"no node of robot {client.keys.prefix} is there; `navloom doctor` says why")
    if as_json:
        print_json(
            _summary(client.keys.prefix, nodes, words, changed, pose, places)
            | {"shadows": [state.to_json() for state in shadows]}
        )
    else:
        print_table(("", ""), rows(client.keys.prefix, nodes, words, changed, shadows, pose, places))


def _summary(
    name: str,
    nodes: Sequence[Node],
    words: Mapping[str, Any],
    changed: Mapping[str, Sequence[str]],
    pose: Any,
    places: Any = None,
) -> dict[str, Any]:
    from navloom_live.operating.introspection import message_fields
    from navloom_live.operating.pose_report import place_fields, pose_fields
    from navloom_live.operating.robot_nodes import missing, platform_age, run_clock_ns

    reason, remedy = _why_stopped(words, nodes)
    clock = run_clock_ns(nodes)
    return {
        "robot": name,
        "run_clock_s": clock * 1e-9 if clock >= 0 else None,
        "platform_age_s": platform_age(nodes),
        "platform": _platform(nodes),
        "pose": None if pose is None else pose_fields(pose),
        "hypotheses": None if places is None else place_fields(places),
        "nodes": len(nodes),
        "missing_nodes": [f"{gone.role} {gone.instance}" for gone in missing(nodes)],
        "silent_nodes": [node.name for node in nodes if node.description is None],
        "changed_parameters": dict(changed),
        "why_stopped": reason,
        "remedy": remedy,
        **{key.replace("/", "_"): None if word is None else message_fields(word) for key, word in words.items()},
    }


def rows(
    name: str,
    nodes: Sequence[Node],
    words: Mapping[str, Any],
    changed: Mapping[str, Sequence[str]],
    shadows: Sequence[ShadowState] = (),
    pose: Any = None,
    places: Any = None,
) -> list[tuple[str, str]]:
    """The printed lines; rows without a value are left out."""
    from navloom_live.operating.robot_nodes import missing, run_clock_ns
    from navloom_live.operating.shadow_report import differing_text

    clock = run_clock_ns(nodes)
    gone = missing(nodes)
    silent = [node.unreadable or node.name for node in nodes if node.description is None]
    found = [
        ("robot", name + (f", run clock {clock * 1e-9:.1f} s" if clock >= 0 else "")),
        ("goal", _goal(words["goal/feedback"], nodes)),
        ("last goal", _result(words["goal/result"])),
        ("pose", _pose(pose)),
        ("localizer", localizer := _localizer(words["goal/feedback"], pose)),
        ("may be at", "" if localizer == "tracking" else _places(places)),
        _driver(words, nodes, localizer in ("", "tracking")),
        ("platform", _platform(nodes)),
        ("active", _selection(words["gate/selection"])),
        *((f"in shadow, {state.role} {state.instance}", differing_text(state)) for state in shadows),
        ("waits to take over", ", ".join(getattr(words["gate/status"], "pending", ()))),
        ("missing", ", ".join(_place(one) for one in gone)),
        ("does not answer", ", ".join(silent)),
        *((f"changed, {source}", ", ".join(values)) for source, values in changed.items()),
    ]
    return [row for row in found if row[1]]


def _platform(nodes: Sequence[Node]) -> str:
    from navloom_live.operating.robot_nodes import answering, platform_age

    if fault := next((node.fault for node in answering(nodes) if node.role == "platform" and node.faulted), ""):
        return f"cannot be driven: {fault}"
    age = platform_age(nodes)
    if age is not None:
        return f"last message {age:.2f} s ago"
    tick = max((node.tick for node in answering(nodes) if node.role == "platform"), default=-1)
    return f"at tick {tick}, in simulated time" if tick >= 0 else "no message so far"


def _goal(feedback: Any, nodes: Sequence[Node]) -> str:
    from navloom.navigation.status_words import progress

    if feedback is None and not _knows_goal(nodes):
        return "unknown: its goal node does not answer"
    if feedback is None or not feedback.goal_id:
        return "none"
    return f"{feedback.goal_id}: {progress(feedback)}"


def _knows_goal(nodes: Sequence[Node]) -> bool:
    return any(node.role == "goal" and node.description is not None for node in nodes)


def _result(result: Any) -> str:
    if result is None:
        return ""
    return f"{result.goal_id}: {result.outcome}, {result.reason}, at ({result.place.x:z.2f}, {result.place.y:z.2f})"


def _pose(estimate: Any) -> str:
    """Where the robot is, how fast, and how sure that is; empty without a pose."""
    from navloom_live.operating.pose_report import pose_fields

    if estimate is None:
        return ""
    at = pose_fields(estimate)
    text = f"({at['x']:z.2f}, {at['y']:z.2f}), {at['heading_deg']:z.0f}°, {at['speed']:z.2f} m/s"
    if at["position_std"] is None:
        return f"{text}, uncertainty not known"
    return f"{text}, ± {at['position_std']:.2f} m, ± {at['heading_std_deg']:.1f}°"


def _places(found: Any) -> str:
    """The likeliest of the places where the robot may be, each with its weight in percent."""
    from navloom_live.operating.pose_report import place_fields

    if found is None or not len(found.poses):
        return ""
    best = [
        f"({at['x']:z.2f}, {at['y']:z.2f}), {at['heading_deg']:z.0f}° ({100.0 * at['weight']:.0f} %)"
        for at in place_fields(found)[:MOST_PLACES]
    ]
    more = len(found.poses) - len(best)
    return "; ".join([*best, *([f"{more} more"] if more else [])])


def _localizer(feedback: Any, estimate: Any) -> str:
    """Whether it is tracking; if not, why, and what to do; empty if that is not known."""
    from navloom.navigation.status_words import WHERE_IT_IS

    said = feedback.localizer if feedback is not None else ""
    if estimate is not None:
        if estimate.state == "tracking":
            return "tracking"
        said = f"{estimate.state}: {estimate.reason}".removesuffix(": ")
    return f"{said}; {WHERE_IT_IS}" if said else ""


def _driver(words: Mapping[str, Any], nodes: Sequence[Node], knows_place: bool) -> tuple[str, str]:
    """The row with the source that drives, or with why the robot is stopped."""
    from navloom.navigation.status_words import who_drives

    gate = words["gate/status"]
    if gate is None:
        return "drives", "unknown: its gate has said nothing so far"
    if not gate.stopped:
        return "drives", who_drives(gate).removesuffix(" drives")
    why, remedy = _why_stopped(words, nodes)
    if remedy and not knows_place and not getattr(words["goal/feedback"], "goal_id", 0):
        remedy = f"the row above comes first, then {remedy}"  # a goal would end as lost again
    return "stopped", why + (f"; {remedy}" if remedy else "")


def _why_stopped(words: Mapping[str, Any], nodes: Sequence[Node]) -> tuple[str, str]:
    """Why the robot is stopped, and the remedy; both empty if it drives or the gate has not reported."""
    from navloom.navigation.status_words import NO_GOAL, why_stopped

    gate, feedback = words["gate/status"], words["goal/feedback"]
    if gate is None:
        return "", ""
    if feedback is None and _knows_goal(nodes):
        feedback = NO_GOAL
    return why_stopped(gate, feedback, words["goal/result"])


def _selection(selection: Any) -> str:
    if selection is None:
        return ""
    return ", ".join(selection.instances) + (f" (selection {selection.epoch})" if selection.epoch else "")


def _place(gone: Any) -> str:
    where = f" on {gone.host}" if gone.host else ""
    return f"{gone.role} {gone.instance} (process {gone.process}{where})"
