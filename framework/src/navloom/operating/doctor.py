"""What is wrong with a live robot, and what to do about it: from the way to it down to its streams."""

from __future__ import annotations

import time
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from navloom.hosting.directory import DirectoryError, RobotFolder, robots
from navloom.messages import Feedback, GateStatus, GoalResult, Message
from navloom.operating.client import Client
from navloom.operating.findings import (
    Finding,
    LoopRate,
    differing,
    failing,
    flowing,
    is_slow,
    is_stuck,
    lagging,
    loop_rate,
    named,
    sharing,
    unheard,
    where,
)
from navloom.operating.host_faults import fate_in_words, left_behind, left_running, restarting
from navloom.operating.joining import find_robot, join
from navloom.operating.looking import (
    NO_GOAL,
    NO_PATH,
    WHERE_IT_IS,
    Missing,
    last_words,
    listing,
    missing,
    neighbours_names,
    why_stopped,
)
from navloom.operating.metering import clock_offsets
from navloom.transport.zenoh_bus import BusError

__all__ = ["Diagnosis", "diagnose", "examine"]

CLOCKS = 0.5
"""s two hosts' wall clocks may differ. The robot minds no difference; its logs and recordings do."""
FOLLOWS: Mapping[str, tuple[str, ...]] = {
    "platform": (),
    "localizer": ("platform",),
    "goal": ("platform",),
    "reference": ("platform", "localizer"),
    "gate": ("platform",),
}
"""Roles that step with the platform, whether there is a goal or not, with those that each of them waits for."""
AGAIN = "run this again in a moment"
ADVICE = {
    NO_PATH: f"{AGAIN}; if it persists, `navloom cancel` it and send the goal again",
    "silent: platform": "`navloom hz platform/odometry` shows whether it arrives; see the log of its process",
    "silent: sensor": "`navloom hz platform/{who}` shows whether it arrives; see its cable and the platform's log",
    "silent": "`navloom hz {who}/command` shows whether it arrives; see the log of its process",
    "gone": f"{AGAIN}: it has just gone, and `navloom up` restarts it",
    "stale": "no node is slow now: `navloom hz '*/command'` shows how old commands are; end other programs on its "
    "host, or make gate.stop_deadline longer",
    "old_selection": f"{AGAIN}; if it persists, restart the process of {{who}}",
}
"""What to do about a stop where no finding names its cause, by how its reason begins: the first that fits."""
ADVANCE = 2.0
"""s within which each of them must have stepped."""


@dataclass(frozen=True)
class Diagnosis:
    """What was found of a robot.

    Attributes:
        robot: REALM/NAME; empty where no robot was found.
        nodes: How many are there.
        findings: Problems first.
        rate: How fast its processes go round; None before it has driven.
    """

    robot: str
    nodes: int
    findings: tuple[Finding, ...]
    rate: LoopRate | None = None

    @property
    def is_healthy(self) -> bool:
        """There are notes at most."""
        return all(finding.severity == "note" for finding in self.findings)


def diagnose(
    robot: str | None = None,
    connect: str | None = None,
    keys: str | None = None,
    identity: str = "viewer",
    insecure: bool = False,
) -> Diagnosis:
    """Examine a robot; see `join` for the arguments. That it cannot be reached is a finding, too.

    Raises:
        DirectoryError: Several robots are up and none was named, or what was named is no REALM/NAME.
        LinkError: An endpoint or certificates that are refused before anybody is asked.
    """
    here = [*left_behind(), *left_running()] if connect is None else []
    folder, config = None, "CONFIG"
    if connect is None:
        if robot is None and len(list(robots())) > 1:
            find_robot(None)
        try:
            running = find_robot(robot)
        except DirectoryError as error:
            return _diagnosis(robot or "", 0, [_first_step(str(error)), *here])
        robot, config = f"{running.realm}/{running.robot}", running.config
        folder = RobotFolder(running.realm, running.robot)
    try:
        with join(robot, connect, keys, identity, insecure, lambda text: here.append(_expiring(text))) as client:
            nodes, found = examine(client, folder, config)
            return replace(_diagnosis(client.keys.prefix, nodes, found + here), rate=loop_rate(client.describe()))
    except BusError as error:
        return _diagnosis(robot or "", 0, [_no_way(str(error)), *here])


def examine(client: Client, folder: RobotFolder | None, config: str) -> tuple[int, list[Finding]]:
    """Everything about a robot whose network was joined.

    Args:
        client: Of the robot.
        folder: Where it was started on this host, else None.
        config: What it was started with.

    Returns:
        Nodes that are there, and the findings.
    """
    nodes = listing(client)
    gone = missing(nodes)
    silent = {one.process for one in gone} | {node["process"] for node in nodes if not node["answers"]}
    again = restarting(folder, silent) if folder is not None else []
    if not nodes:
        return 0, [*again, _nobody(client)]
    answering = [node for node in nodes if node["answers"]]
    found = [*_absent(gone, folder, config), *_mute(nodes, folder), *again]
    for check in (failing, lagging, flowing, differing, unheard, sharing):
        found += check(answering)
    found += _clocks(client, answering)
    ill = {one.role for one in gone} | {node["role"] for node in nodes if not node["answers"] or _is_ill(node)}
    stands = _standing(client, answering)
    found = _with_waiting(found, stands, ill, folder)
    is_slowed = any(is_slow(node) and node["active"] for node in answering)
    words = last_words(client)
    found += _unsure(words["goal/feedback"])
    return len(nodes), found + _stopped(words, has_cause=bool(stands or ill or is_slowed))


def _is_ill(node: Mapping[str, Any]) -> bool:
    """An active node with a finding for which others may not step."""
    return node["active"] and bool(node["faulted"] or is_stuck(node) or node.get("waits_for"))


def _diagnosis(robot: str, nodes: int, found: Sequence[Finding]) -> Diagnosis:
    return Diagnosis(robot, nodes, tuple(sorted(found, key=lambda finding: finding.severity == "note")))


# --- the way to it --------------------------------------------------------------------------------------------------


def _first_step(text: str) -> Finding:
    """No such robot is up here."""
    what, _, remedy = text.partition(": start one")
    if remedy:
        return Finding("problem", what, f"start one{remedy}")
    return Finding("problem", text, "`navloom up CONFIG` starts it; --connect ENDPOINT reaches one on another host")


def _no_way(text: str) -> Finding:
    """Its network cannot be joined."""
    if "nothing listens" in text:
        remedy = "start the robot (`navloom up CONFIG`) or its router (`navloom router ENDPOINT`), or correct --connect"
    elif "no host is called" in text:
        remedy = "correct --connect, or live.router: give a name that this host knows, or an address"
    elif "navloom keys renew" in text or "set the clock" in text:
        remedy = "every host needs certificates that are valid now; `navloom doctor` warns 30 days ahead"
    elif "TLS" in text or "tls/" in text or "certificate" in text:
        remedy = "both ends need tls/ and certificates of one `navloom keys new`, given with --keys, or neither does"
    else:
        remedy = "is the endpoint right, is its router up (`navloom router`), and is tls/ used on both ends or on none?"
    return Finding("problem", text, remedy)


def _expiring(text: str) -> Finding:
    """Certificates of this host expire soon, or have expired."""
    what, _, remedy = text.partition("; ")
    return Finding("problem" if "expired" in what else "note", what, f"{remedy}; a link ends when its certificate does")


def _nobody(client: Client) -> Finding:
    others = neighbours_names(client)
    known = f"; there are {', '.join(others)}: choose with --robot" if others else ""
    remedy = "`navloom up` starts its processes; a certificate that is revoked, or another robot's, sees no node either"
    return Finding("problem", f"the network is up, but no node of robot {client.keys.prefix} is{known}", remedy)


# --- who is there ---------------------------------------------------------------------------------------------------


def _absent(gone: Sequence[Missing], folder: RobotFolder | None, config: str) -> list[Finding]:
    """Nodes that are missing, by the process they belong to."""
    fates = folder.fates() if folder is not None else {}
    found = []
    for process in dict.fromkeys(one.process for one in gone):
        ours = [one for one in gone if one.process == process]
        names = ", ".join(f"{one.role} {one.instance}" for one in ours)
        host = ours[0].host
        what = f"{names}: missing; of process {process}" + (f" on host {host}" if host else "")
        if folder is not None and process in fates:
            fate, remedy = fate_in_words(folder, process, fates[process])
            what += f": {fate}"
        elif host:
            remedy = f"`navloom up {config} --host {host}` there; if it is up, check whether it reaches the router"
        else:
            remedy = f"`navloom node {config} {process}` starts it"
        found.append(Finding("problem", what, remedy))
    return found


def _mute(nodes: Sequence[Mapping[str, Any]], folder: RobotFolder | None) -> list[Finding]:
    """Nodes that are announced, but do not answer, by process."""
    fates = folder.fates() if folder is not None else {}
    mute = [node for node in nodes if not node["answers"]]
    found = []
    for process in dict.fromkeys(node["process"] for node in mute):
        names = ", ".join(named(node) for node in mute if node["process"] == process)
        what = f"{names}: announced, but not answering; of process {process or 'unknown'}"
        remedy = "its process is suspended, overloaded, or gone with its host: run this again, or restart it"
        if folder is not None and process in fates:
            fate, remedy = fate_in_words(folder, process, fates[process])
            what += f": {fate}"
        found.append(Finding("problem", what, remedy))
    return found


# --- what they do ---------------------------------------------------------------------------------------------------


def _clocks(client: Client, nodes: Sequence[Mapping[str, Any]]) -> list[Finding]:
    return [
        Finding(
            "problem",
            f"the wall clock of {host} is {offset.seconds:+.2f} s (± {offset.uncertain:.3f} s) off this host's",
            "the robot is not affected, but logs and recordings are: set both with a time service such as chrony",
        )
        for host, offset in sorted(clock_offsets(client, nodes).items())
        if abs(offset.seconds) - offset.uncertain > CLOCKS
    ]


def _standing(client: Client, nodes: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Nodes that should step with every tick and do not."""
    left = {named(node): node for node in nodes if node["role"] in FOLLOWS and node["active"]}
    limit, is_late = time.monotonic() + ADVANCE, False
    while left and not is_late:
        is_late = time.monotonic() > limit  # asked once more after the limit: this process may have been held up itself
        time.sleep(0.1)
        now = {named(node): node["tick"] for node in client.describe()}
        left = {name: node for name, node in left.items() if now.get(name) in (None, node["tick"])}
    return list(left.values())


def _with_waiting(
    found: Sequence[Finding], stands: Sequence[Mapping[str, Any]], ill: Container[str], folder: RobotFolder | None
) -> list[Finding]:
    """Findings and what follows from them: a node that does not step waits for the first before it that is ill.

    Args:
        found: So far.
        stands: Nodes that do not step.
        ill: Roles of which something is found already.
        folder: Of the robot, where it was started on this host.
    """
    told = list(found)
    still = {node["role"] for node in stands}
    for node in stands:
        if node["role"] in ill or any(role in ill or role in still for role in FOLLOWS[node["role"]]):
            continue
        since = "has not stepped so far" if node["tick"] < 0 else f"has not stepped since tick {node['tick']}"
        told.append(Finding("problem", f"{named(node)} {since} ({where(node)})", _restart(node, folder)))
    for cause in ("platform", "localizer"):
        names = [named(node) for node in stands if cause in FOLLOWS[node["role"]]]
        place = next((n for n, one in enumerate(told) if one.what.startswith(f"{cause} ")), None)
        if names and place is not None and (cause in ill or cause in still):
            waiting = f"{', '.join(names)} wait{'s' if len(names) == 1 else ''} for it"
            told[place] = replace(told[place], what=f"{told[place].what}; {waiting}")
            break
    return told


def _restart(node: Mapping[str, Any], folder: RobotFolder | None) -> str:
    log = f"see {folder.path / node['process']}.log" if folder is not None else "see the log of its process"
    hardware = "it may wait for its hardware; " if node["role"] == "platform" else ""
    return f"{hardware}{log}; `kill -KILL {node['pid']}` on {node['host']} makes `navloom up` restart it"


def _unsure(feedback: Message | None) -> list[Finding]:
    """A localizer that is not tracking, as the goal heard it."""
    if not isinstance(feedback, Feedback) or not feedback.localizer:
        return []
    return [Finding("problem", f"the localizer is {feedback.localizer}", WHERE_IT_IS)]


def _stopped(words: Mapping[str, Message | None], has_cause: bool) -> list[Finding]:
    """A robot that is kept from driving. What is missing or ill has been told already, and stops it as well."""
    status, feedback, result = words["gate/status"], words["goal/feedback"], words["goal/result"]
    if not isinstance(status, GateStatus) or not status.stopped or (has_cause and not status.latched):
        return []
    goal = feedback if isinstance(feedback, Feedback) else NO_GOAL
    if status.reason == NO_PATH and goal.state != "driving":
        return []
    text, remedy = why_stopped(status, goal, result if isinstance(result, GoalResult) else None)
    remedy = next((advice for begin, advice in ADVICE.items() if status.reason.startswith(begin)), remedy)
    who = status.reason.partition(": ")[2].removeprefix("sensor ")
    return [Finding("problem", f"the robot is stopped: {text}", remedy.format(who=who))]
