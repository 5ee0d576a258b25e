"""Metrics of a live robot for Prometheus: rates, ages, stops by reason, deadlines, CPU and memory."""

from __future__ import annotations

import math
import os
import platform
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from navloom.messages import GateStatus
from prometheus_client import Metric

from navloom_live.live.description import Description
from navloom_live.operating.robot_nodes import Node, answering
from navloom_live.operating.stream_subscription import Told

__all__ = ["Stops", "families"]

MOST_REASONS = 32
"""Largest number of stop reasons that are counted by name; further ones are counted together as `other`."""
TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
PAGE = os.sysconf("SC_PAGE_SIZE")
Labels = Mapping[str, Any]
Sample = tuple[str, Labels, float]
"""Name of a metric, labels, value."""

_HELP = {
    "navloom_up": ("gauge", "1 while a node of the robot answers."),
    "navloom_nodes_missing": ("gauge", "Nodes of the config that are missing."),
    "navloom_node_answers": ("gauge", "1 while the node answers, 0 while it is announced and silent."),
    "navloom_node_active": ("gauge", "1 where the node is the active instance of its role."),
    "navloom_node_step_seconds": ("gauge", "Median duration of the node's newest steps."),
    "navloom_node_busy_seconds": ("gauge", "Duration of the current step so far; 0 between steps."),
    "navloom_node_faults": ("gauge", "Steps in a row in which the node's plugin failed."),
    "navloom_messages_published_total": ("counter", "Messages that a node published on a port."),
    "navloom_messages_received_total": ("counter", "Messages that a node received of a stream."),
    "navloom_messages_dropped_total": ("counter", "Messages of a stream that a node's full queue dropped."),
    "navloom_messages_malformed_total": ("counter", "Messages of a stream that a node could not decode."),
    "navloom_message_age_seconds": ("gauge", "Age of messages where a node received them, since the platform's stamp."),
    "navloom_platform_silence_seconds": ("gauge", "Time since the last platform message at a node."),
    "navloom_platform_ticks_total": ("counter", "Ticks of the platform."),
    "navloom_platform_late_ticks_total": ("counter", "Ticks that began more than half a period late or were skipped."),
    "navloom_platform_driven_ticks_total": ("counter", "Ticks in which the wheels turned."),
    "navloom_platform_own_ticks_total": ("counter", "Driven ticks whose own command came before the next tick."),
    "navloom_platform_stops_total": ("counter", "Stops by the platform itself because the gate's command was stale."),
    "navloom_gate_chain_seconds": ("gauge", "From a tick of the platform to its command at the gate."),
    "navloom_gate_stopped": ("gauge", "1 while the gate stops the robot."),
    "navloom_gate_stops_total": ("counter", "Stops by the gate since this program started, by reason."),
    "navloom_process_cpu_seconds_total": ("counter", "Processor time of a process of this host."),
    "navloom_process_resident_bytes": ("gauge", "Memory of a process of this host."),
}
"""Type and help text of each metric."""


class Stops:
    """Counts the stops that the gate reports.

    Attributes:
        is_stopped: Whether the robot is stopped; None before the gate's first status.
        counts: Stops by reason, since the gate's first status.
    """

    def __init__(self) -> None:
        self.is_stopped: bool | None = None
        self.counts: Counter[str] = Counter()
        self._reason = ""

    def take(self, told: Told) -> None:
        """Count a status message of the gate."""
        status = told.message
        if not isinstance(status, GateStatus):
            return
        # Only the kind, without the names in the text: each would be a time series of its own.
        reason = status.why.head if status.why is not None else status.limit or "unknown"
        if status.stopped and self.is_stopped is not None and reason != self._reason:
            is_known = reason in self.counts or len(self.counts) < MOST_REASONS
            self.counts[reason if is_known else "other"] += 1
        self.is_stopped, self._reason = status.stopped, reason if status.stopped else ""


def families(robot: str, nodes: Sequence[Node], missing: int, stops: Stops) -> Iterator[Metric]:
    """All metrics of a robot, for a registry of the Prometheus client.

    Args:
        robot: realm/name.
        nodes: From `navloom_live.operating.robot_nodes.listing`.
        missing: Number of missing nodes.
        stops: Stops of its gate.
    """
    realm, _, name = robot.partition("/")
    made = {metric: Metric(metric.removesuffix("_total"), meaning, kind) for metric, (kind, meaning) in _HELP.items()}
    for metric, labels, value in _samples(nodes, missing, stops):
        if math.isfinite(value):
            texts = {label: str(text) for label, text in labels.items()}
            made[metric].add_sample(metric, {"realm": realm, "robot": name, **texts}, value)
    return (metric for metric in made.values() if metric.samples)


def _samples(nodes: Sequence[Node], missing: int, stops: Stops) -> Iterator[Sample]:
    described = answering(nodes)
    yield "navloom_up", {}, float(bool(described))
    yield "navloom_nodes_missing", {}, missing
    for node in nodes:
        yield from _of_node(node, node.description)
    if stops.is_stopped is not None:
        yield "navloom_gate_stopped", {}, float(stops.is_stopped)
    for reason, count in sorted(stops.counts.items()):
        yield "navloom_gate_stops_total", {"reason": reason}, count
    here = platform.node()
    processes = {(node.process, node.pid) for node in described if node.host == here}
    for process, pid in sorted(processes):
        yield from _of_process(process, pid)


def _of_node(node: Node, said: Description | None) -> Iterator[Sample]:
    who = {"role": node.role, "instance": node.instance}
    yield "navloom_node_answers", who, float(said is not None)
    if said is None:
        return
    yield "navloom_node_active", who, float(said.active)
    yield "navloom_node_busy_seconds", who, said.busy_s or 0.0
    yield "navloom_node_faults", who, said.faulted
    yield from _known("navloom_node_step_seconds", who, said.step_s)
    yield from _known("navloom_platform_silence_seconds", who, said.silence_s)
    for port, count in said.published.items():
        yield "navloom_messages_published_total", {**who, "port": port}, count
    for stream, counts in said.streams.items():
        to = {**who, "stream": stream}
        yield "navloom_messages_received_total", to, counts.received
        yield "navloom_messages_dropped_total", to, counts.dropped
        yield "navloom_messages_malformed_total", to, counts.malformed
        yield from _known("navloom_message_age_seconds", {**to, "quantile": "0.5"}, counts.age_p50_s)
        yield from _known("navloom_message_age_seconds", {**to, "quantile": "0.99"}, counts.age_p99_s)
    instance = {"instance": node.instance}
    yield from _known("navloom_platform_ticks_total", instance, said.ticks)
    yield from _known("navloom_platform_late_ticks_total", instance, said.late_ticks)
    yield from _known("navloom_platform_driven_ticks_total", instance, said.driven_ticks)
    yield from _known("navloom_platform_own_ticks_total", instance, said.own_ticks)
    yield from _known("navloom_platform_stops_total", instance, said.stops)
    yield from _known("navloom_gate_chain_seconds", {"quantile": "0.5"}, said.chain_p50_s)
    yield from _known("navloom_gate_chain_seconds", {"quantile": "0.99"}, said.chain_p99_s)


def _known(metric: str, labels: Labels, value: float | None) -> Iterator[Sample]:
    """The sample, if there is a value."""
    if value is not None:
        yield metric, labels, value


def _of_process(process: str, pid: int) -> Iterator[Sample]:
    """CPU time and memory of a process of this host; nothing if it has just ended."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text("ascii", "replace")
        resident = int(Path(f"/proc/{pid}/statm").read_text("ascii").split()[1]) * PAGE
    except (OSError, IndexError, ValueError):
        return
    values = stat.rpartition(")")[2].split()
    labels = {"process": process, "pid": pid}
    yield "navloom_process_cpu_seconds_total", labels, (int(values[11]) + int(values[12])) * TICK_S
    yield "navloom_process_resident_bytes", labels, resident
