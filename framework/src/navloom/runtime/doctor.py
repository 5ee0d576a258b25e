"""What is wrong with a live robot, and what to do about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from navloom.runtime.client import Client
from navloom.runtime.looking import listing, offsets

__all__ = ["Finding", "examine"]

CLOCKS = 0.5
"""s two hosts' wall clocks may differ before it is said; nothing here depends on them, logs and recordings do."""
POOL = 64.0
"""MB of shared memory a process may take."""
NEEDED = (
    "platform",
    "localizer",
    "mapper",
    "planner",
    "controller",
    "avoider",
    "recovery",
    "goal",
    "reference",
    "gate",
)


@dataclass(frozen=True)
class Finding:
    """Something wrong: what, and what to do."""

    what: str
    remedy: str


def examine(client: Client) -> list[Finding]:
    """Everything that is wrong with a robot whose network was joined."""
    nodes = listing(client)
    answering = [node for node in nodes if node["answers"]]
    found = _missing(nodes) + _differences(answering) + _streams(answering) + _hosts(client, answering)
    return found + _standing(client, answering)


def _missing(nodes: Sequence[Mapping[str, Any]]) -> list[Finding]:
    roles = {node["role"] for node in nodes}
    found = [
        Finding(f"{role}: no instance is there", "start the process or host it belongs to, see [live] of the config")
        for role in NEEDED
        if role not in roles
    ]
    for node in nodes:
        name = f"{node['role']} {node['instance']}"
        if not node["answers"]:
            found.append(
                Finding(
                    f"{name}: is announced, but does not answer", "its process is stopped or overloaded: restart it"
                )
            )
        elif node.get("busy"):
            found.append(Finding(f"{name}: is in a long step", "see its plugin; `navloom hz` of its streams"))
    return found


def _differences(nodes: Sequence[Mapping[str, Any]]) -> list[Finding]:
    found = []
    for package in sorted({package for node in nodes for package in node["versions"]}):
        by_version: dict[str, list[str]] = {}
        for node in nodes:
            by_version.setdefault(node["versions"].get(package, "none"), []).append(f"{node['process']}@{node['host']}")
        if len(by_version) > 1:
            text = "; ".join(f"{version}: {', '.join(sorted(set(who)))}" for version, who in sorted(by_version.items()))
            found.append(Finding(f"{package} differs: {text}", "install the same version on every host"))
    configs = {node["config_sha256"]: f"{node['process']}@{node['host']}" for node in nodes}
    if len(configs) > 1:
        who = ", ".join(sorted(configs.values()))
        found.append(Finding(f"the config differs between processes: {who}", "start all of them with the same file"))
    return found


def _streams(nodes: Sequence[Mapping[str, Any]]) -> list[Finding]:
    found = []
    for node in nodes:
        name = f"{node['role']} {node['instance']}"
        for stream, counts in node["streams"].items():
            if counts["malformed"]:
                found.append(
                    Finding(
                        f"{name}: {counts['malformed']} malformed messages on {stream}: {counts['complaint']}",
                        "find who sends them; both sides must have the same versions",
                    )
                )
            if counts["dropped"] > max(20, counts["received"] // 10):
                found.append(
                    Finding(
                        f"{name}: {counts['dropped']} of {counts['received']} messages on {stream} were dropped unread",
                        "the node is slower than the stream: give it a process or a core of its own, or lower the rate",
                    )
                )
        if node.get("ticks", 0) > 100 and node["late_ticks"] > node["ticks"] // 100:
            found.append(
                Finding(
                    f"{name}: {node['late_ticks']} of {node['ticks']} ticks were late",
                    "the host is overloaded: move mapper and planner elsewhere, or make run.period longer",
                )
            )
    return found


def _hosts(client: Client, nodes: Sequence[Mapping[str, Any]]) -> list[Finding]:
    found = []
    for host, offset in sorted(offsets(client).items()):
        if abs(offset) > CLOCKS:
            found.append(
                Finding(
                    f"the clock of {host} is {offset:+.1f} s off this one's",
                    "the robot does not mind, logs and recordings do: run a time service such as chrony there",
                )
            )
    for host, free in {node["host"]: node["shared_memory_mb"] for node in nodes}.items():
        if free is None or free < POOL:
            text = "none" if free is None else f"{free:.0f} MB free"
            found.append(
                Finding(
                    f"{host} has too little shared memory ({text})",
                    f"give /dev/shm {POOL:.0f} MB a process (containers: --shm-size); it works without, but slower",
                )
            )
    return found


def _standing(client: Client, nodes: Sequence[Mapping[str, Any]]) -> list[Finding]:
    """A clock that stands, and a stop that waits for somebody."""
    found = []
    again = {(node["role"], node["instance"]): node for node in client.describe()}
    for node in nodes:
        later = again.get((node["role"], node["instance"]))
        if node["role"] in ("platform", "localizer") and later is not None and later["tick"] == node["tick"]:
            found.append(Finding(f"{node['role']} {node['instance']}: its tick stands still", "restart its process"))
    status = client.last("gate", "main", "status")
    if getattr(status, "latched", False):
        reason = getattr(status, "reason", "")
        found.append(Finding(f"the robot is stopped: {reason}", "`navloom resume` when the way is clear"))
    return found
