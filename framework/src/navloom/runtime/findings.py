"""What is wrong with a live robot, as far as its nodes' own words tell, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from navloom.roles import PATIENT
from navloom.runtime import links

__all__ = ["Finding", "differing", "failing", "flowing", "sharing", "unheard"]

LOW = 8.0
"""MB of free shared memory below which a process that starts cannot join."""
POOL = links.POOL / 2**20
"""MB of shared memory a process takes for large messages."""
BUSY, BUSY_LONG = 0.5, 5.0
"""s in one step after which a node is said to be busy, and one that may compute for long."""
SILENT = 1.0
"""s without the platform after which a process does not hear it."""
FEW = 20
"""Messages a node may lose, or ticks that may be late, before it is said."""
SMALL = ("odometry", "contact", "truth", "step", "parameters")
"""Ports of a platform that are no sensor's."""

Node = Mapping[str, Any]


@dataclass(frozen=True)
class Finding:
    """Something about a robot that its people should know.

    Attributes:
        severity: "problem" where the robot does not do what it should, else "note".
        what: What there is.
        remedy: What to do.
    """

    severity: Literal["problem", "note"]
    what: str
    remedy: str


def named(node: Node) -> str:
    """Role and instance."""
    return f"{node['role']} {node['instance']}"


def where(node: Node) -> str:
    """Process and host."""
    return f"{node['process']} on {node['host']}"


def failing(nodes: Sequence[Node]) -> list[Finding]:
    """Plugins that raise, hang or are late."""
    found = []
    for node in nodes:
        if node["faulted"]:
            times = "in its last step" if node["faulted"] == 1 else f"{node['faulted']} steps in a row"
            remedy = f"repair the plugin, or put another in charge with `navloom swap {node['role']} NAME`"
            found.append(Finding("problem", f"{named(node)} failed {times}: {node['fault']}", remedy))
        if (node["busy_s"] or 0.0) > (BUSY_LONG if node["role"] in PATIENT else BUSY):
            what = f"{named(node)} has been in one step for {node['busy_s']:.1f} s"
            found.append(Finding("problem", what, "its plugin hangs or is too slow; live.hang_timeout ends it"))
        if node.get("late_ticks", 0) > max(FEW, node.get("ticks", 0) // 100):
            what = f"{named(node)}: {node['late_ticks']} of {node['ticks']} ticks since its start came late"
            remedy = "the host is overloaded: move mapper and planner elsewhere, or make run.period longer"
            found.append(Finding("problem", what, remedy))
    return found


def flowing(nodes: Sequence[Node]) -> list[Finding]:
    """Streams with messages that nobody could read, or that were dropped unread where each counts."""
    found = []
    for node in nodes:
        for stream, counts in node["streams"].items():
            if counts["malformed"]:
                what = f"{named(node)}: {counts['malformed']} malformed messages on {stream}: {counts['complaint']}"
                found.append(
                    Finding("problem", what, "find who sends them; both ends need the same version of navloom")
                )
            if not counts["latest"] and counts["dropped"] > max(FEW, counts["received"] // 10):
                what = f"{named(node)}: {counts['dropped']} of {counts['received']} messages on {stream} dropped unread"
                remedy = "it is slower than the stream: give its process a core of its own, or lower the rate"
                found.append(Finding("problem", what, remedy))
    return found


def differing(nodes: Sequence[Node]) -> list[Finding]:
    """Versions and configs that are not the same everywhere."""
    found = []
    for package in sorted({package for node in nodes for package in node["versions"]}):
        by_version = _grouped((node["versions"].get(package, "none"), where(node)) for node in nodes)
        if len(by_version) > 1:
            what = f"{package} is not of one version: {_listed(by_version)}"
            found.append(Finding("problem", what, "install the same version on every host"))
    by_config = _grouped((node["config_sha256"][:8], where(node)) for node in nodes)
    if len(by_config) > 1:
        what = f"the processes have different configs: {_listed(by_config)}"
        remedy = "start all of them with the same file, --set and --seed; `navloom config check --json` tells its hash"
        found.append(Finding("problem", what, remedy))
    return found


def unheard(nodes: Sequence[Node]) -> list[Finding]:
    """Processes that do not hear a platform which is heard by others."""
    ages = {where(node): node["silence_s"] for node in nodes if node["silence_s"] is not None}
    if not ages or min(ages.values()) > SILENT:
        return []
    remedy = "the network between them is cut or full: `navloom hz platform/odometry` there, and the router"
    return [
        Finding("problem", f"process {process} has not heard the platform for {age:.1f} s", remedy)
        for process, age in ages.items()
        if age > SILENT
    ]


def sharing(nodes: Sequence[Node]) -> list[Finding]:
    """Shared memory that is short, and large messages that cannot pass through it."""
    found = []
    for host, free in {node["host"]: node["shared_memory_mb"] for node in nodes}.items():
        remedy = f"give /dev/shm {POOL:.0f} MB for each process there (containers: --shm-size)"
        if free is None or free < LOW:
            amount = "no shared memory" if free is None else f"only {free:.1f} MB of shared memory left"
            found.append(Finding("problem", f"{host} has {amount}: a process that starts there cannot join", remedy))
        elif free < POOL:
            found.append(Finding("note", f"{host} has {free:.0f} MB of shared memory left", remedy))
    hosts = {f"{node['role']}/{node['instance']}": node["host"] for node in nodes}
    for node in nodes:
        for stream, counts in node["streams"].items():
            source, _, port = stream.rpartition("/")
            is_scan = source.startswith("platform/") and port not in SMALL
            is_large = is_scan or (source.startswith("mapper/") and port == "map")
            if is_large and counts["received"] and hosts.get(source, node["host"]) != node["host"]:
                what = f"{named(node)} on {node['host']} gets {stream} over the network, from {hosts[source]}"
                remedy = "shared memory works within a host: where its age is high (`navloom hz`), move it there"
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
