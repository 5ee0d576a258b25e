"""Findings about a live robot from its nodes' own descriptions, each with a remedy."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from navloom.messages import StopReason
from navloom.roles import ROLES

from navloom_live.live.description import Description, StreamSummary
from navloom_live.timing import PLATFORM_SILENCE, STUCK_AFTER, STUCK_AFTER_PATIENT, rate_of_wait
from navloom_live.transport import links

__all__ = ["Finding", "LoopRate", "differing", "doubled", "failing", "flowing", "is_slow", "is_stuck", "lagging",
           "loop_rate", "sharing", "unheard"]  # fmt: skip

LOW = 8.0
"""Free shared memory below which a new process cannot join, MB."""
POOL = links.POOL / 2**20
"""Shared memory that a process takes for large messages, MB."""
SAME_START_TOLERANCE = 5.0
"""Largest difference between two answers about the start of one process, s; two robots differ by more, or in PID."""
FEW = 20
"""Number of lost messages, or of late ticks, that is tolerated without a finding."""
OLD = 0.05
"""Share of a robot's ticks that may be driven by the command of an earlier tick without a finding."""
SMALL = ("odometry", "contact", "truth", "step", "parameters")
"""Ports of a platform that are not sensors."""

Severity = Literal["problem", "note"]


@dataclass(frozen=True)
class Finding:
    """Something about a robot that its operators should know.

    Attributes:
        severity: "problem" if the robot does not do what it should, else "note".
        what: What was found.
        remedy: What to do about it.
    """

    severity: Severity
    what: str
    remedy: str


def where(node: Description) -> str:
    """Process and host."""
    return f"{node.process} on {node.host}"


def _is_patient(node: Description) -> bool:
    """Whether its step may take long, because no motor waits for it."""
    role = ROLES.get(node.role)
    if node.is_patient is not None:
        return node.is_patient
    return role is not None and role.is_patient


def is_slow(node: Description) -> bool:
    """Whether its usual step exceeds its period. Mappers and planners may: nothing waits for them in each tick."""
    return not _is_patient(node) and (node.step_s or 0.0) > (node.period_s or math.inf)


def is_stuck(node: Description) -> bool:
    """Whether its current step has taken longer than its role may take."""
    return (node.busy_s or 0.0) > (STUCK_AFTER_PATIENT if _is_patient(node) else STUCK_AFTER)


def failing(nodes: Sequence[Description]) -> list[Finding]:
    """Findings for plugins that raise, hang, are late or command far more than is allowed.

    Late ticks are not reported for a platform whose own steps are slow: that is their cause.
    """
    found = []
    for node in nodes:
        if node.faulted:
            times = "in its last step" if node.faulted == 1 else f"{node.faulted} steps in a row"
            remedy = f"fix the plugin; {_instead(node, nodes)}"
            found.append(Finding("problem", f"{node.name} failed {times}: {node.fault}", remedy))
        if node.active and node.waits_for:
            found.append(Finding("problem", *StopReason("waits", node.name, " and ".join(node.waits_for)).in_words()))
        for note in node.notes or ():
            found.append(Finding("note", note, "check the units in its code and parameters: rad/s and m/s"))
        if is_stuck(node):
            what = f"{node.name} has been in one step for {node.busy_s:.1f} s"
            remedy = f"its plugin hangs or is too slow; live.hang_timeout ends its process; {_instead(node, nodes)}"
            found.append(Finding("problem", what, remedy))
        if is_slow(node):
            what = f"{node.name} takes {(node.step_s or 0.0) * 1e3:.0f} ms per step, longer than its period"
            remedy = f"make it faster, or run.period longer; {_instead(node, nodes)}"
            if node.plugin is None:
                remedy = "its host is overloaded: end other programs there, or make run.period longer"
            severity: Severity = "problem" if node.active else "note"
            found.append(Finding(severity, f"{what} of {(node.period_s or 0.0) * 1e3:.0f} ms", remedy))
        elif (node.late_ticks or 0) > max(FEW, (node.ticks or 0) // 100):
            what = f"{node.name}: {node.late_ticks} of {node.ticks} ticks since its start came late"
            remedy = "its host is overloaded: end other programs there, make run.period longer, or move mapper and "
            found.append(Finding("problem", what, remedy + "planner to another host (live.hosts)"))
    return found


def lagging(nodes: Sequence[Description]) -> list[Finding]:
    """Findings for a robot that is driven by commands of earlier ticks, with the rate that it could hold."""
    found = []
    for node in nodes:
        driven = node.driven_ticks or 0
        old = driven - (node.own_ticks or 0)
        if old <= max(FEW, driven * OLD):
            continue
        what = f"{old} of {driven} ticks were driven by the command of an earlier tick"
        remedy = "end other programs on its hosts, or make run.period longer"
        rate = loop_rate(nodes)
        if rate is not None:
            what += f"; {rate}"
        found.append(Finding("problem", what, remedy))
    return found


@dataclass(frozen=True)
class LoopRate:
    """Loop time of a robot's processes and the rate that they can hold.

    Attributes:
        median_s, most_s: Time from a platform stamp to the tick's last command at the gate: median, 99th percentile.
        holds_hz: Highest tick rate at which 99 of 100 ticks would be driven by their own commands.
    """

    median_s: float
    most_s: float
    holds_hz: float

    def __str__(self) -> str:
        took = f"a tick's commands take {self.median_s * 1e3:.1f} ms (99 %: {self.most_s * 1e3:.1f} ms)"
        return f"{took}: these processes sustain up to {self.holds_hz:.0f} Hz"


def loop_rate(nodes: Sequence[Description]) -> LoopRate | None:
    """Loop rate measured by the gate in its last drives; None if it has measured too little."""
    for node in nodes:
        if node.chain_p50_s and node.chain_p99_s:
            return LoopRate(node.chain_p50_s, node.chain_p99_s, rate_of_wait(node.chain_p99_s))
    return None


def _instead(node: Description, nodes: Sequence[Description]) -> str:
    """How to replace a node that fails."""
    role = node.role
    if node.plugin is None:
        return "it is a node of navloom itself: report this with the log of its process"
    if role == "platform":
        return "a platform cannot be swapped: restart the robot with another plugin in [platform]"
    if not node.active:
        return "it is not active, so the robot drives without it"
    others = [other.instance for other in nodes if other.role == role and not other.active]
    if others:
        return f"`navloom swap {role} {others[0]}` makes another active"
    table = f"[{role}]" if role in ROLES else f"[[node]] {role}"
    return f"the config has no other {role} to swap to: restart the robot with another plugin in {table}"


def flowing(nodes: Sequence[Description]) -> list[Finding]:
    """Findings for streams with unreadable messages, or with dropped messages where each one counts."""
    found = []
    for node in nodes:
        for stream, counts in node.streams.items():
            if counts.malformed:
                what = f"{node.name}: {counts.malformed} malformed messages on {stream}: {counts.complaint}"
                found.append(Finding("problem", what, "find the sender; both ends need the same version of navloom"))
            if counts.misrouted:
                found.append(_misrouted(f"{node.name}: {counts.misrouted} messages on {stream}", counts))
            if not is_slow(node) and not counts.latest and counts.dropped > max(FEW, counts.received // 10):
                what = f"{node.name}: {counts.dropped} of {counts.received} messages on {stream} dropped unread"
                remedy = "it is slower than the stream: give its process a core of its own, or lower the rate"
                found.append(Finding("problem", what, remedy))
    return found


def _misrouted(which: str, counts: StreamSummary) -> Finding:
    """Finding for messages of other streams: a few come from restarts, many from a publisher with a wrong key."""
    what = f"{which} belong to another stream and were refused, the last to {counts.origin or 'an unknown one'}"
    if counts.misrouted <= FEW:
        remedy = "Zenoh can confuse two streams when a process restarts; nothing to do while the count does not rise"
        return Finding("note", what, remedy)
    remedy = "find the publisher, such as a replay or a second robot of this name; if there is none, restart the "
    return Finding("problem", what, remedy + "router, or the robot if it has no router")


def differing(nodes: Sequence[Description]) -> list[Finding]:
    """Findings for versions and configs that differ between processes."""
    found = []
    for package in sorted({package for node in nodes for package in node.versions}):
        by_version = _grouped((node.versions.get(package, "none"), where(node)) for node in nodes)
        if len(by_version) > 1:
            what = f"{package} has different versions: {_listed(by_version)}"
            found.append(Finding("problem", what, "install the same version on every host"))
    by_config = _grouped((node.config_sha256[:8], where(node)) for node in nodes)
    if len(by_config) > 1:
        what = f"the processes have different configs: {_listed(by_config)}"
        remedy = "start all of them with the same file, --set and --seed; `navloom config check --json` prints its hash"
        found.append(Finding("problem", what, remedy))
    return found


def unheard(nodes: Sequence[Description]) -> list[Finding]:
    """Findings for processes that do not receive the platform's messages while others do."""
    silent = {where(node): (node, node.silence_s) for node in nodes if node.silence_s is not None}
    # If no process receives its messages, the fault is the platform's, and reported as such.
    if not silent or min(silence for _, silence in silent.values()) > PLATFORM_SILENCE:
        return []
    home = {node.host for node in nodes if node.role == "platform"}
    found = []
    for process, (node, silence) in silent.items():
        if silence > PLATFORM_SILENCE:
            remedy = "the network between them is cut or full: `navloom hz platform/odometry` there shows it"
            if node.host in home:
                remedy = f"it hangs, or its host gives it no CPU time: `kill -KILL {node.pid}` restarts it"
            what = f"process {process} has not received a platform message for {silence:.1f} s"
            found.append(Finding("problem", what, remedy))
    return found


def doubled(answers: Sequence[Description]) -> list[Finding]:
    """Findings for nodes that several processes run: all of them publish on the node's streams.

    Args:
        answers: Every description that arrives, also several of one instance.
    """
    runs: dict[tuple[Any, ...], list[str]] = {}
    for name in dict.fromkeys(description.name for description in answers):
        descriptions: list[Description] = []
        for answer in (description for description in answers if description.name == name):
            if not any(_is_same_process(answer, other) for other in descriptions):
                descriptions.append(answer)
        if len(descriptions) > 1:
            who = sorted({f"host {one.host} (process {one.pid}{_since(one)})" for one in descriptions})
            runs.setdefault(tuple(who), []).append(name)
    remedy = "two robots of one name take each other's commands: end one, or give it another robot.name"
    return [
        Finding(
            "problem", f"{', '.join(names)}: several processes publish its streams: on {' and on '.join(who)}", remedy
        )
        for who, names in runs.items()
    ]


def _is_same_process(description: Description, other: Description) -> bool:
    # Containers may share host name and process ID.
    is_near = abs(_started(description) - _started(other)) < SAME_START_TOLERANCE
    return (description.host, description.pid) == (other.host, other.pid) and is_near


def _started(node: Description) -> float:
    """Wall clock at which the process of a node started, s since 1970; 0 if it does not say."""
    return 0.0 if node.wall_ns is None else node.wall_ns * 1e-9 - (node.up_s or 0.0)


def _since(node: Description) -> str:
    started = _started(node)
    return time.strftime(", since %Y-%m-%d %H:%M:%S", time.localtime(started)) if started else ""


def sharing(nodes: Sequence[Description]) -> list[Finding]:
    """Findings for too little shared memory, and for large messages that cross hosts and cannot use it."""
    found = []
    for host, free in {node.host: node.shared_memory_mb for node in nodes if node.shares_memory}.items():
        remedy = f"give /dev/shm {POOL:.0f} MB for each process there (containers: --shm-size)"
        if free is None or free < LOW:
            amount = "no shared memory" if free is None else f"only {free:.1f} MB of shared memory left"
            found.append(Finding("problem", f"{host} has {amount}: a process that starts there cannot join", remedy))
        elif free < POOL:
            found.append(Finding("note", f"{host} has {free:.0f} MB of shared memory left", remedy))
    hosts = {f"{node.role}/{node.instance}": node.host for node in nodes}
    for node in nodes:
        for stream, counts in node.streams.items():
            source, _, port = stream.rpartition("/")
            is_scan = source.startswith("platform/") and port not in SMALL
            is_large = is_scan or (source.startswith("mapper/") and port == "map")
            if is_large and counts.received and hosts.get(source, node.host) != node.host:
                what = f"{node.name} on {node.host} gets {stream} over the network, from {hosts[source]}"
                remedy = "within one host it costs less: if its age is high (`navloom hz`), move the reader there"
                found.append(Finding("note", what, remedy))
    return found


def _grouped(pairs: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for value, process in pairs:
        if process not in found.setdefault(value, []):
            found[value].append(process)
    return found


def _listed(groups: Mapping[str, Sequence[str]]) -> str:
    return "; ".join(f"{value} in {', '.join(sorted(who))}" for value, who in sorted(groups.items()))
