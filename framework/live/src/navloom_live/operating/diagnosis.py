"""Finds what is wrong with a live robot and how to fix it, from the connection down to its streams."""

from __future__ import annotations

import time
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

from navloom.messages import Feedback, GateStatus, GoalResult, Message
from navloom.navigation.status_words import NO_GOAL, WHERE_IT_IS, has_no_path, why_stopped

from navloom_live.hosting.runtime_folders import DirectoryError, RobotFolder, robots
from navloom_live.live.description import Description
from navloom_live.operating.client import Client
from navloom_live.operating.health_findings import (
    Finding,
    LoopRate,
    differing,
    doubled,
    failing,
    flowing,
    is_slow,
    is_stuck,
    lagging,
    loop_rate,
    sharing,
    unheard,
    where,
)
from navloom_live.operating.host_faults import fate_in_words, left_behind, left_running, restarting
from navloom_live.operating.introspection import last_words
from navloom_live.operating.robot_lookup import find_robot, join
from navloom_live.operating.robot_nodes import Missing, Node, answering, listing, missing, neighbours_names
from navloom_live.operating.stream_measurement import clock_offsets
from navloom_live.transport.zenoh_bus import BusError

__all__ = ["Diagnosis", "diagnose", "diagnose_joined", "examine"]

CLOCK_OFFSET_LIMIT = 0.5
"""Largest difference of two hosts' wall clocks without a finding, s. It matters to logs and recordings, not driving."""
# Kept by hand: who waits for whom is decided in `engine/nodes`, and a change there must be repeated here.
FOLLOWS: Mapping[str, tuple[str, ...]] = {
    "platform": (),
    "world": ("platform",),
    "localizer": ("platform",),
    "goal": ("platform",),
    "reference": ("platform", "localizer"),
    "gate": ("platform",),
}
"""Roles that step with the platform whether or not there is a goal, each with the roles it waits for."""
IN_TURNS = "if it is lost in turns, record some and run `navloom calibrate` on them: its scans may be late"
"""Remedy for a robot whose sensors are late, which nothing else shows."""
STEP_WAIT = 2.0
"""Time within which each of these roles must step, s."""


@dataclass(frozen=True)
class Diagnosis:
    """Result of an examination.

    Attributes:
        robot: REALM/NAME; empty if no robot was found.
        nodes: Number of nodes found.
        findings: All findings, problems first.
        rate: Loop rate of its processes; None before it has driven.
    """

    robot: str
    nodes: int
    findings: tuple[Finding, ...]
    rate: LoopRate | None = None

    @property
    def is_healthy(self) -> bool:
        """Whether there is no problem; notes may remain."""
        return all(finding.severity == "note" for finding in self.findings)


def diagnose(
    robot: str | None = None,
    connect: str | None = None,
    keys: str | None = None,
    identity: str = "viewer",
    insecure: bool = False,
) -> Diagnosis:
    """Examine a robot; see `join` for the arguments. An unreachable robot is a finding too.

    Raises:
        DirectoryError: Several robots are up and none was named, or the name is not REALM/NAME.
        LinkError: The endpoint or the certificates are refused before a connection is tried.
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


def diagnose_joined(client: Client) -> Diagnosis:
    """Examine a robot whose network was joined."""
    home = client.home
    running = None if home is None else home.told()
    nodes, found = examine(client, home, "CONFIG" if running is None else running.config)
    return replace(_diagnosis(client.keys.prefix, nodes, found), rate=loop_rate(client.describe()))


def examine(client: Client, folder: RobotFolder | None, config: str) -> tuple[int, list[Finding]]:
    """Examine a robot whose network was joined.

    Args:
        client: Client of the robot.
        folder: Folder of the robot if it was started on this host, else None.
        config: Config that it was started with.

    Returns:
        Number of nodes found, and the findings.
    """
    nodes = listing(client)
    gone = missing(nodes)
    mute = [node for node in nodes if node.description is None]
    silent = {one.process for one in gone} | {node.process for node in mute if node.process is not None}
    again = restarting(folder, silent) if folder is not None else []
    if not nodes:
        return 0, [*again, _no_nodes(client)]
    described = answering(nodes)
    found = [*_absent(gone, folder, config), *_unreadable(mute), *_mute(mute, folder), *again]
    for check in (failing, lagging, flowing, differing, unheard, sharing):
        found += check(described)
    found += doubled(client.all_described())
    found += _clocks(client, described)
    ill = {one.role for one in gone} | {node.role for node in mute} | {node.role for node in described if _is_ill(node)}
    halted = _not_stepping(client, described)
    found = _with_waiting(found, halted, ill, folder)
    is_slowed = any(is_slow(node) and node.active for node in described)
    words = last_words(client)
    found += _unsure(words["goal/feedback"])
    return len(nodes), found + _stopped(words, has_cause=bool(halted or ill or is_slowed))


def _is_ill(node: Description) -> bool:
    """Whether a node is active and has a fault that may keep other nodes from stepping."""
    return node.active and bool(node.faulted or is_stuck(node) or node.waits_for)


def _diagnosis(robot: str, nodes: int, found: Sequence[Finding]) -> Diagnosis:
    return Diagnosis(robot, nodes, tuple(sorted(found, key=lambda finding: finding.severity == "note")))


# --- the connection -------------------------------------------------------------------------------------------------


def _first_step(text: str) -> Finding:
    """Finding: no such robot is up on this host."""
    what, _, remedy = text.partition(": start one")
    if remedy:
        return Finding("problem", what, f"start one{remedy}")
    return Finding("problem", text, "`navloom up CONFIG` starts it; --connect ENDPOINT reaches one on another host")


def _no_way(text: str) -> Finding:
    """Finding: its network cannot be joined."""
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
    """Finding: certificates of this host expire soon or have expired."""
    what, _, remedy = text.partition("; ")
    return Finding("problem" if "expired" in what else "note", what, f"{remedy}; a link ends when its certificate does")


def _no_nodes(client: Client) -> Finding:
    others = neighbours_names(client)
    known = f"; there are {', '.join(others)}: choose with --robot" if others else ""
    remedy = "`navloom up` starts its processes; a revoked certificate, or another robot's, sees no nodes either"
    return Finding("problem", f"the network is up, but no node of robot {client.keys.prefix} is{known}", remedy)


# --- who is there ---------------------------------------------------------------------------------------------------


def _absent(gone: Sequence[Missing], folder: RobotFolder | None, config: str) -> list[Finding]:
    """Findings for missing nodes, one for each process."""
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


def _unreadable(mute: Sequence[Node]) -> list[Finding]:
    """Findings for nodes whose description this version cannot read."""
    found = [node.unreadable.rpartition("; ") for node in mute if node.unreadable]
    return [Finding("problem", what, remedy) for what, _, remedy in found]


def _mute(nodes: Sequence[Node], folder: RobotFolder | None) -> list[Finding]:
    """Findings for nodes that are announced but do not answer, one for each process."""
    fates = folder.fates() if folder is not None else {}
    mute = [node for node in nodes if not node.unreadable]
    found = []
    for process in dict.fromkeys(node.process for node in mute):
        names = ", ".join(node.name for node in mute if node.process == process)
        what = f"{names}: announced, but not answering; of process {process or 'unknown'}"
        remedy = "its process is suspended, overloaded, or gone with its host: run this again, or restart it"
        if folder is not None and process in fates:
            fate, remedy = fate_in_words(folder, process, fates[process])
            what += f": {fate}"
        found.append(Finding("problem", what, remedy))
    return found


# --- what they do ---------------------------------------------------------------------------------------------------


def _clocks(client: Client, nodes: Sequence[Description]) -> list[Finding]:
    return [
        Finding(
            "problem",
            f"the wall clock of {host} is {offset.seconds:+.2f} s (± {offset.uncertain:.3f} s) off this host's",
            "the robot is not affected, but logs and recordings are: set both with a time service such as chrony",
        )
        for host, offset in sorted(clock_offsets(client, nodes).items())
        if abs(offset.seconds) - offset.uncertain > CLOCK_OFFSET_LIMIT
    ]


def _not_stepping(client: Client, nodes: Sequence[Description]) -> list[Description]:
    """Nodes that should step with every tick but do not."""
    left = {node.name: node for node in nodes if node.role in FOLLOWS and node.active}
    limit, is_late = time.monotonic() + STEP_WAIT, False
    while left and not is_late:
        is_late = time.monotonic() > limit  # check once more after the limit: this process itself may have been delayed
        time.sleep(0.1)
        now = {node.name: node.tick for node in client.describe()}
        left = {name: node for name, node in left.items() if now.get(name) in (None, node.tick)}
    return list(left.values())


def _with_waiting(
    found: Sequence[Finding], halted: Sequence[Description], ill: Container[str], folder: RobotFolder | None
) -> list[Finding]:
    """Add the nodes that do not step: as findings of their own, or to the finding of the node that they wait for.

    Args:
        found: Findings so far.
        halted: Nodes that do not step.
        ill: Roles that already have a finding.
        folder: Folder of the robot if it was started on this host.
    """
    told = list(found)
    still = {node.role for node in halted}
    for node in halted:
        if node.role in ill or any(role in ill or role in still for role in FOLLOWS[node.role]):
            continue
        since = "has not stepped so far" if node.tick < 0 else f"has not stepped since tick {node.tick}"
        told.append(Finding("problem", f"{node.name} {since} ({where(node)})", _restart(node, folder)))
    for cause in ("platform", "localizer"):
        names = [node.name for node in halted if cause in FOLLOWS[node.role]]
        place = next((n for n, finding in enumerate(told) if finding.what.startswith(f"{cause} ")), None)
        if names and place is not None and (cause in ill or cause in still):
            waiting = f"{', '.join(names)} wait{'s' if len(names) == 1 else ''} for it"
            # One finding for the cause, not one for each node that waits for it.
            told[place] = replace(told[place], what=f"{told[place].what}; {waiting}")
            break
    return told


def _restart(node: Description, folder: RobotFolder | None) -> str:
    log = f"see {folder.path / node.process}.log" if folder is not None else "see the log of its process"
    hardware = "it may wait for its hardware; " if node.role == "platform" else ""
    return f"{hardware}{log}; `kill -KILL {node.pid}` on {node.host} makes `navloom up` restart it"


def _unsure(feedback: Message | None) -> list[Finding]:
    """Finding for a localizer that is not tracking, according to the goal's feedback."""
    if not isinstance(feedback, Feedback) or not feedback.localizer:
        return []
    return [Finding("problem", f"the localizer is {feedback.localizer}", f"{WHERE_IT_IS}; {IN_TURNS}")]


def _stopped(words: Mapping[str, Message | None], has_cause: bool) -> list[Finding]:
    """Finding for a robot that is kept from driving, unless an earlier finding already explains the stop."""
    status, feedback, result = words["gate/status"], words["goal/feedback"], words["goal/result"]
    # A stop whose cause is listed above needs no finding; one by an operator does, since only `resume` ends it.
    if not isinstance(status, GateStatus) or not status.stopped or (has_cause and not status.latched):
        return []
    goal = feedback if isinstance(feedback, Feedback) else NO_GOAL
    if has_no_path(status) and goal.state != "driving":
        return []
    text, remedy = why_stopped(status, goal, result if isinstance(result, GoalResult) else None)
    advice = status.why.advice if status.why is not None else ""
    return [Finding("problem", f"the robot is stopped: {text}", advice or remedy)]
